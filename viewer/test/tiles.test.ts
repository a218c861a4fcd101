import { describe, expect, it } from "vitest";
import { crc32 } from "../src/core/crc32.js";
import { decodeTile, WORDS, type DecodedTile } from "../src/core/orthoview/decode.js";
import { readTile } from "../src/core/orthoview/header.js";
import { withPlanes } from "./fuzz/shells.js";
import { listVectors, readJson, readVector } from "./vectors.js";

/** What scripts/write_tile_vectors.py writes beside each tile. */
interface Expected {
  readonly direction: number;
  readonly index: number;
  readonly level: number;
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
  readonly depth_base: number;
  readonly valid: number;
  readonly crc32: Readonly<Record<"depth" | "normal" | "coverage" | "length" | "flags", number>>;
}

/** Node has no WebP decoder: colour is grey here, and looked at in the browser. */
const grey = (_: Uint8Array, width: number, height: number): Promise<Uint8ClampedArray> =>
  Promise.resolve(new Uint8ClampedArray(width * height * 4).fill(99));

/** The planes of a tile, row by row over all pixels, 0 where nothing is. */
function planesOf({ pixels, width, height, count }: DecodedTile): Record<keyof Expected["crc32"], Uint8Array> {
  const size = width * height;
  const planes = {
    depth: new Uint8Array(size * 2),
    normal: new Uint8Array(size * 2),
    coverage: new Uint8Array(size),
    length: new Uint8Array(size),
    flags: new Uint8Array(size),
  };
  for (let k = 0; k < count; k++) {
    const [place, color, surface] = pixels.subarray(k * WORDS, k * WORDS + WORDS) as unknown as [number, number, number];
    const at = ((place >>> 12) & 4095) * width + (place & 4095);
    planes.depth.set([place >>> 24, color >>> 24], at * 2);
    planes.normal.set([surface & 63, (surface >>> 6) & 63], at * 2);
    planes.coverage[at] = ((surface >>> 12) & 15) + 1;
    planes.length[at] = ((surface >>> 16) & 7) + 1;
    planes.flags[at] = (surface >>> 19) & 3;
    expect(color & 0xffffff).toBe(0x636363);
  }
  return planes;
}

/** Coded, and as Python wrote them until 2026-11-25. */
const FOLDERS = ["tiles", "tiles/deflated"] as const;
const tilesOf = (folder: string): string[] => listVectors(folder, ".ffov").map((name) => `${folder}/${name}`);

async function expectDecoded(bytes: Uint8Array, name: string): Promise<void> {
  const expected = readJson<Expected>(name.replace(".ffov", ".json"));
  const tile = await decodeTile(bytes, name, grey);
  const { direction, index, level, x, y, width, height, depth_base: depthBase, valid } = expected;
  expect(tile).toMatchObject({ direction, layer: index, level, x, y, width, height, depthBase, count: valid });
  for (const [plane, content] of Object.entries(planesOf(tile))) {
    expect(crc32(content), plane).toBe(expected.crc32[plane as keyof Expected["crc32"]]);
  }
}

/** A tile with the planes of `other` whose bit in `choice` is set; both tell the same. */
function mixed(tile: Uint8Array, other: Uint8Array, choice: number): Uint8Array {
  const [own, others] = [readTile(tile, "").planes, readTile(other, "").planes];
  return withPlanes(tile, new Map([...own].map(([kind, plane]) => [kind, (choice >> kind) & 1 ? others.get(kind)! : plane])));
}

describe("orthoview tiles written by Python", () => {
  it.each(FOLDERS.flatMap(tilesOf))("%s decodes to the same planes", async (name) => {
    await expectDecoded(readVector(name), name);
  });

  it.each(["foliage-first", "noise", "row", "column"])("%s with planes in any mixture of codecs", async (name) => {
    const [coded, deflated] = FOLDERS.map((folder) => readVector(`${folder}/${name}.ffov`));
    for (let choice = 0; choice < 128; choice += 2) await expectDecoded(mixed(coded!, deflated!, choice), `tiles/${name}.ffov`);
  });

  it.each(FOLDERS.flatMap((folder) => tilesOf(`${folder}/corrupt`)))("%s is refused", async (name) => {
    await expect(decodeTile(readVector(name), name, grey)).rejects.toMatchObject({ tag: "corrupt" });
  });

  it.each(FOLDERS)("%s cut short anywhere are refused", async (folder) => {
    const whole = readVector(`${folder}/foliage-first.ffov`);
    for (const length of [0, 1, 39, 40, 88, 200, whole.length - 1]) {
      await expect(decodeTile(whole.subarray(0, length), "short", grey)).rejects.toMatchObject({ tag: "corrupt" });
    }
  });
});
