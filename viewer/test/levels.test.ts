import { expect, it } from "vitest";
import { maskedLevels } from "../src/core/decode/levels.js";

it("keeps what is cut away from bleeding into the smaller sizes of an image", () => {
  const [clear, red] = [[0, 255, 0, 0], [255, 0, 0, 255]];
  const levels = maskedLevels(new Uint8ClampedArray([...red, ...clear, ...clear, ...clear]), 2, 2);
  expect(levels.map(({ width }) => width)).toEqual([2, 1]);
  expect([...levels[1]!.pixels]).toEqual([255, 0, 0, 64]);
  expect([...levels[0]!.pixels]).toEqual([...red, 255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0]);
});
