import { inflateRawSync } from "node:zlib";
import { describe, expect, it } from "vitest";
import { buffersOfBlockMap, decodeBlockMap } from "../src/core/blockmap/decode.js";
import { leapHeights } from "../src/core/blockmap/leaps.js";
import { decodeBlockMapObjects } from "../src/core/blockmap/objects.js";
import { blockMapKey, blockMapObjectsKey, cellOf } from "../src/core/keys.js";
import { listVectors, readJson } from "./vectors.js";

/** What scripts/write_blockmap_vectors.py writes; text is base64, but for the values deflated. */
interface Expected {
  readonly blockmap: string;
  readonly object_ids: string;
  readonly extent: [number, number];
  readonly n: number;
  readonly m: number;
  readonly low: number;
  readonly step: number;
  readonly across: number;
  readonly by_area: boolean;
  readonly walls: number;
  readonly thresholds: number[];
  readonly highest: number;
  readonly tops: string;
  readonly slopes: string;
  readonly floors: string;
  readonly sides: string;
  readonly objects: string;
}

const bytesOf = (text: string): Uint8Array => new Uint8Array(Buffer.from(text, "base64"));
const unpacked = (text: string): Uint8Array => new Uint8Array(inflateRawSync(Buffer.from(text, "base64")));
const vector = (name: string): Expected => readJson<Expected>(`blockmaps/${name}`);
const NAMES = listVectors("blockmaps", ".json").filter((name) => name !== "corrupt.json");
const DAMAGED = readJson<{ readonly blockmap: Record<string, string>; readonly object_ids: Record<string, string> }>("blockmaps/corrupt.json");

/** Node has no WebP decoder: colour is grey here, and looked at in the browser. */
const grey = (_: Uint8Array, width: number, height: number): Promise<Uint8ClampedArray> =>
  Promise.resolve(new Uint8ClampedArray(width * height * 4).fill(99));

describe("BlockMaps written by Python", () => {
  it.each(NAMES)("%s decodes to the same", async (name) => {
    const expected = vector(name);
    const found = await decodeBlockMap(bytesOf(expected.blockmap), name, grey, expected.extent);
    const { n, m, low, step, across, thresholds, highest } = expected;
    expect(found).toMatchObject({ n, m, low, step, across, thresholds, highest, byArea: expected.by_area });
    expect(found.tops).toEqual(unpacked(expected.tops));
    expect(new Uint8Array(found.slopes ?? [])).toEqual(unpacked(expected.slopes));
    expect(found.floors ?? new Uint8Array()).toEqual(unpacked(expected.floors));
    expect(found.sides).toEqual(unpacked(expected.sides));
    expect(found.sides.filter((rows, at) => at % 4 === 2 && rows > 0).length).toBe(expected.walls);
    expect(found.colors.length).toBe(4 * n * (n + m));
    expect(buffersOfBlockMap(found).length).toBe(3 + (found.slopes ? 1 : 0) + (found.floors ? 1 : 0));
  });

  it.each(NAMES)("object ids of %s too", (name) => {
    const { object_ids: ids, objects } = vector(name);
    expect(new Uint8Array(decodeBlockMapObjects(bytesOf(ids), name).buffer)).toEqual(unpacked(objects));
  });

  it.each(Object.keys(DAMAGED.blockmap))("%s is refused", async (name) => {
    await expect(decodeBlockMap(bytesOf(DAMAGED.blockmap[name]!), name, grey, [9, 9])).rejects.toMatchObject({ tag: "corrupt" });
  });

  it.each(Object.keys(DAMAGED.object_ids))("object ids are refused: %s", (name) => {
    const bytes = bytesOf(DAMAGED.object_ids[name]!);
    expect(() => decodeBlockMapObjects(bytes, name)).toThrow(expect.objectContaining({ tag: "corrupt" }));
  });

  it("cut short anywhere are refused", async () => {
    const { blockmap, object_ids: ids } = vector("small-by-area.json");
    const [whole, objects] = [bytesOf(blockmap), bytesOf(ids)];
    for (const length of [0, 1, 39, 40, 99, whole.length - 1]) {
      await expect(decodeBlockMap(whole.subarray(0, length), "short", grey, [9, 9])).rejects.toMatchObject({ tag: "corrupt" });
    }
    for (const length of [0, 1, 15, 16, objects.length - 1]) {
      expect(() => decodeBlockMapObjects(objects.subarray(0, length), "short")).toThrow(expect.objectContaining({ tag: "corrupt" }));
    }
  });

  it("wherever their bytes lie", async () => {
    const { blockmap, extent } = vector("middle-by-area.json");
    const bytes = bytesOf(blockmap);
    const within = new Uint8Array(bytes.length + 7);
    within.set(bytes, 3);
    const found = await decodeBlockMap(within.subarray(3, 3 + bytes.length), "within", grey, extent);
    expect(found).toEqual(await decodeBlockMap(bytes, "alone", grey, extent));
  });
});

it("heights of one top, or of two, are those of numpy", () => {
  expect(leapHeights(Float32Array.of(-Infinity, 2.5, -Infinity))).toEqual([2.5, 2.5, 2.5]);
  expect(leapHeights(Float32Array.of(4, 0))).toEqual([0.2, 3, 3.88].map(Math.fround));
});

it("keys name the cell", () => {
  const cell = { level: 2, x: -1, y: 0, z: 3 };
  expect(cellOf(blockMapKey("2/-1/0/3", "0123456789abcdef"))).toEqual(cell);
  expect(cellOf(blockMapObjectsKey("2/-1/0/3", "0123456789abcdef"))).toEqual(cell);
});
