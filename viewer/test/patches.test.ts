import { describe, expect, it } from "vitest";
import { BOX } from "../src/core/orthoview/blocks.js";
import { decodeTile, WORDS, type DecodedTile } from "../src/core/orthoview/decode.js";
import { joinPatches, OFF_PLANE, PATCH_MARGIN, TEXEL_WORDS } from "../src/core/orthoview/patches.js";
import { listVectors, readVector } from "./vectors.js";

const noise = (_: Uint8Array, width: number, height: number): Promise<Uint8ClampedArray> =>
  Promise.resolve(Uint8ClampedArray.from({ length: width * height * 4 }, (_, n) => (n * 37) % 251));
const tileOf = (name: string): Promise<DecodedTile> => decodeTile(readVector(`tiles/${name}`), name, noise);

/** A pixel by itself: place as a number, depth code, color, surface. */
type Pixel = readonly [number, number, number, number];

function pixelAt(pixels: Uint32Array, k: number): Pixel {
  const [place, color, surface] = [pixels[k]!, pixels[k + 1]!, pixels[k + 2]!];
  return [place & 0xffffff, (place >>> 24) | ((color >>> 24) << 8), color & 0xffffff, surface];
}

interface Patch {
  readonly column: number;
  readonly row: number;
  readonly edge: number;
  readonly middle: number;
  readonly slopes: readonly [number, number];
  readonly first: number;
}

function patchAt(points: Uint32Array, k: number): Patch {
  const [place, middle, first, surface] = pixelAt(points, k);
  return {
    column: place & 4095,
    row: place >>> 12,
    edge: 2 << ((surface >>> 22) & 3),
    middle: middle + ((surface >>> 24) & 1) / 2,
    slopes: [((surface & 2047) - 1024) / 16, (((surface >>> 11) & 2047) - 1024) / 16],
    first: first * 4,
  };
}

/** All pixels of points, those of patches by their planes. */
function* pixelsOf({ pixels, texels }: DecodedTile): Generator<Pixel> {
  for (let k = 0; k < pixels.length; k += WORDS) {
    if (pixels[k + 2]! < 0x80000000) {
      yield pixelAt(pixels, k);
      continue;
    }
    const { column, row, edge, middle, slopes, first } = patchAt(pixels, k);
    for (let n = 0; n < edge * edge; n++) {
      const [i, j] = [n % edge, Math.floor(n / edge)];
      const depth = middle + (i - (edge - 1) / 2) * slopes[0] + (j - (edge - 1) / 2) * slopes[1];
      const at = (first + n) * TEXEL_WORDS;
      yield [(column + i) | ((row + j) << 12), depth, texels[at]!, texels[at + 1]!];
    }
  }
}

const byPlace = (pixels: Iterable<Pixel>): Map<number, Pixel> => new Map(Array.from(pixels, (pixel) => [pixel[0], pixel]));

describe("patches", () => {
  const names = listVectors("tiles", ".ffov");

  it.each(names)("%s: have every pixel once, as it is but for a little depth", async (name) => {
    const tile = await tileOf(name);
    const joined = joinPatches(tile);
    const found = [...pixelsOf(joined)];
    expect(found.length).toBe(tile.count);
    const [before, after] = [byPlace(pixelsOf(tile)), byPlace(found)];
    for (const [place, [, depth, color, surface]] of before) {
      const [, near, ...rest] = after.get(place)!;
      expect(rest).toEqual([color, surface]);
      expect(Math.abs(near - depth)).toBeLessThanOrEqual(OFF_PLANE);
    }
  });

  it.each(names)("%s: stay in their blocks, within their boxes", async (name) => {
    const tile = await tileOf(name);
    const { pixels, blocks, count } = joinPatches(tile);
    expect([blocks.count, blocks.starts[0], blocks.starts[blocks.count]]).toEqual([tile.blocks.count, 0, count]);
    for (let n = 0; n < blocks.count; n++) {
      const [left, top, front, right, bottom, back] = blocks.boxes.subarray(n * BOX, n * BOX + BOX) as unknown as number[];
      for (let k = blocks.starts[n]! * WORDS; k < blocks.starts[n + 1]! * WORDS; k += WORDS) {
        if (pixels[k + 2]! < 0x80000000) continue;
        const { column, row, edge, middle, slopes } = patchAt(pixels, k);
        const deep = ((edge / 2 + PATCH_MARGIN) * (Math.abs(slopes[0]) + Math.abs(slopes[1]))) / 8;
        const place = [column - PATCH_MARGIN - left!, right! - column - edge - PATCH_MARGIN];
        place.push(row - PATCH_MARGIN - top!, bottom! - row - edge - PATCH_MARGIN, middle / 8 - deep - front!, back! - middle / 8 - deep);
        expect(Math.min(...place)).toBeGreaterThan(-1e-4);
      }
    }
  });

  it("leave few points of a plane, and all of what is loose or thin", async () => {
    const [size, words] = [64, (column: number, row: number, surface: number) => [column | (row << 12) | ((column & 31) << 24), 7, surface]];
    const whole = (15 << 12) | 0x80000 | 2079;
    const tile = await tileOf(names[0]!);
    const of = (surface: number): DecodedTile => {
      const pixels = Uint32Array.from({ length: 32 * 32 }, (_, n) => n).reduce<number[]>(
        (all, n) => all.concat(words(n % 32, Math.floor(n / 32), surface)), [],
      );
      const blocks = { count: 1, starts: Uint32Array.of(0, 1024), boxes: new Float32Array(BOX), cones: new Float32Array(5) };
      return { ...tile, width: size, height: size, count: 1024, pixels: Uint32Array.from(pixels), blocks };
    };
    expect(joinPatches(of(whole)).count).toBe(16);
    expect(joinPatches(of(whole & ~0x80000)).count).toBe(1024);
    expect(joinPatches(of(whole & ~(1 << 12))).count).toBe(1024);
  });
});
