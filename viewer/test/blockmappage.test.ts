import { expect, it } from "vitest";
import { BlockMapPage, layerBytes } from "../src/three/blockmappage.js";

const [N, M] = [16, 64];

/** A BlockMap of one byte throughout. */
const mapOf = (byte: number) => ({
  n: N, m: M, low: 0, step: 1, across: 1, byArea: true, thresholds: [0, 0, 0] as const, highest: 1, slopes: null, floors: null,
  tops: new Uint8Array(4 * N * N).fill(byte),
  sides: new Uint8Array(16 * N * N).fill(byte),
  colors: new Uint8ClampedArray(4 * N * (N + M)).fill(byte),
});

/** The first byte of a layer. */
const first = ({ texture, layerBytes }: BlockMapPage, layer: number): number => (texture.image.data as Uint8Array)[layer * layerBytes]!;

it("a page has room for the maps that it has, and for no more than as many again", () => {
  const page = new BlockMapPage(N, M);
  let made = 0;
  page.texture.addEventListener("dispose", () => made++);
  for (let count = 1; count <= page.capacity; count++) {
    expect(page.isFull).toBe(false);
    expect(page.put(mapOf(count % 256))).toBe(count - 1);
    expect(page.bytes).toBeLessThan(2 * count * layerBytes(N, M));
    expect((page.texture.image.data as Uint8Array).length).toBe(page.bytes);
  }
  expect(page.isFull).toBe(true);
  expect(page.bytes).toBeLessThanOrEqual(6 << 20);
  expect(made).toBe(Math.ceil(Math.log2(page.capacity)));
});

it("what is in a page stays there when it grows, and goes to the card again", () => {
  const page = new BlockMapPage(N, M);
  for (const byte of [5, 6, 7, 8]) page.put(mapOf(byte));
  page.drop(1);
  expect(page.put(mapOf(9))).toBe(1);
  // As when the picture has been drawn.
  page.texture.clearLayerUpdates();
  page.drop(2);
  page.put(mapOf(10));
  expect([...page.texture.layerUpdates]).toEqual([2]);
  page.put(mapOf(11));
  expect([0, 1, 2, 3, 4].map((layer) => first(page, layer))).toEqual([5, 9, 10, 8, 11]);
  expect([...page.texture.layerUpdates].sort()).toEqual([0, 1, 2, 3, 4]);
  for (let layer = 0; layer < 5; layer++) page.drop(layer);
  expect(page.isEmpty).toBe(true);
});
