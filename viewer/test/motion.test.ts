import { expect, it } from "vitest";
import { maskedLevels } from "../src/core/decode/levels.js";
import { MotionQuality, type Quality } from "../src/app/motion.js";

it("draws less and less while a slow card is in motion, and all once it rests", () => {
  const applied: Quality[] = [];
  const wanted = { supersampling: 4, leastGain: 10, layers: 2 };
  const motion = new MotionQuality(wanted, (quality) => applied.push(quality));
  motion.advance(0, false, 1, 500);
  expect(applied).toEqual([]);
  motion.advance(10, true, 2, 500);
  motion.advance(20, true, 2, 500);
  motion.advance(30, true, 3, 300);
  motion.advance(40, true, 4, 20);
  expect(applied).toEqual([{ ...wanted, supersampling: 1 }, { supersampling: 1, leastGain: 40, layers: 1 }]);
  expect(motion.reduced).toBe(true);
  motion.advance(500, false, 4, 20);
  expect(applied.at(-1)).toEqual(wanted);
  motion.advance(510, true, 5, 20);
  expect(applied).toHaveLength(3);
});

it("keeps what is cut away from bleeding into the smaller sizes of an image", () => {
  const [clear, red] = [[0, 255, 0, 0], [255, 0, 0, 255]];
  const levels = maskedLevels(new Uint8ClampedArray([...red, ...clear, ...clear, ...clear]), 2, 2);
  expect(levels.map(({ width }) => width)).toEqual([2, 1]);
  expect([...levels[1]!.pixels]).toEqual([255, 0, 0, 64]);
  expect([...levels[0]!.pixels]).toEqual([...red, 255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0]);
});
