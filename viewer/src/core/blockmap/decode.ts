import { corrupt } from "../errors.js";
import { inflate } from "../inflate.js";
import type { ColorDecoder } from "../orthoview/decode.js";
import { checkWebp } from "../orthoview/webp.js";
import { readBlockMap } from "./header.js";
import { LEAPS, leapHeights, topsOf, writeDistances } from "./leaps.js";
import { unfolded, type Unfolded } from "./unfold.js";

/** Steps of a slope for a rise of 1. */
export const STEEP = 32;
/** Directions that normals of walls may have. */
export const TURNS = 64;
/** Of the sides of a texel, TURNS-ths of a turn, counter-clockwise from x. */
const OUTWARD = [32, 0, 48, 16] as const;

/** A BlockMap, ready for upload. Texel (i, j): column i along x, row j along y from the cell's lower corner. */
export interface DecodedBlockMap {
  /** Texels a side. */
  readonly n: number;
  /** Columns of the image of walls. */
  readonly m: number;
  /** Metres of code 1 above the cell's lower corner. */
  readonly low: number;
  /** Metres from code to code. */
  readonly step: number;
  /** Columns of a side in the image of walls. */
  readonly across: number;
  /** Walls have texels by their area, from their upper to their lower end; else all from the highest code down to `low`. */
  readonly byArea: boolean;
  /** Metres, ascending, that distances are told for. */
  readonly thresholds: readonly [number, number, number];
  /** Metres of the highest point. */
  readonly highest: number;
  /** (n, n, 4) code, 0 = nothing, and texels to the nearest one above each of `thresholds`, see leaps.ts. */
  readonly tops: Uint8Array;
  /** (n, n, 2) rise along x and y, STEEP-ths; null: all tops are flat. */
  readonly slopes: Int8Array | null;
  /** (n, n) code of where what stands in a texel ends below, 0 or 1 = nowhere; null: nowhere in all. */
  readonly floors: Uint8Array | null;
  /** (4, n, n, 4) of each side first column, first row and rows in the image of walls, and TURNS-ths of its normal counter-clockwise from x; 0 rows: no wall. */
  readonly sides: Uint8Array;
  /** (n, n + m, 4) sRGB: tops, then the image of walls. */
  readonly colors: Uint8ClampedArray;
}

/**
 * Reads a BlockMap. Throws `corrupt` for anything but a whole one. Allocates at most 64 bytes for each of its n (n + m) texels, and
 * what `inflate` takes.
 *
 * extent: metres of its cell along x and y.
 */
export async function decodeBlockMap(
  bytes: Uint8Array, where: string, decodeColor: ColorDecoder, extent: readonly [number, number],
): Promise<DecodedBlockMap> {
  const header = readBlockMap(bytes, where);
  const { n, m, low, step, byArea } = header;
  checkWebp(header.colors, n + m, n, where);
  const heights = inflate(header.heights, n * n + n / 2 + (header.floored ? n * n : 0), where);
  const codes = heights.subarray(0, n * n);
  if (codes.every((code) => code === 0)) throw corrupt("BlockMap of nothing", where);
  const slopes = header.slopes && interleaved(inflate(header.slopes, 2 * n * n, where));
  const floors = header.floored ? heights.slice(n * n + n / 2) : null;
  if (floors?.some((floor, texel) => floor > codes[texel]!)) throw corrupt("BlockMap has floors above its tops", where);
  const own = unfolded(codes, floors, heights.subarray(n * n, n * n + n / 2), header);
  if (own.rows > n) throw corrupt("BlockMap has more walls than its image", where);
  const turns = inflate(header.turns, own.sides.length, where);
  if (turns.some((turn) => turn >= TURNS)) throw corrupt("BlockMap has walls turned too far", where);
  const tops = topsOf(codes, slopes, low, step, [extent[0] / n, extent[1] / n], STEEP);
  const thresholds = leapHeights(tops);
  const highest = tops.reduce((most, top) => Math.max(most, top));
  const colors = await decodeColor(header.colors, n + m, n, where);
  return {
    n, m, low, step, byArea, thresholds, highest, slopes, floors, colors,
    across: own.across,
    tops: withDistances(codes, tops, n, thresholds),
    sides: sidesOf(own, turns, n),
  };
}

/** The buffers that hold it. */
export function buffersOfBlockMap({ tops, slopes, floors, sides, colors }: DecodedBlockMap): ArrayBuffer[] {
  return [tops, ...(slopes ? [slopes] : []), ...(floors ? [floors] : []), sides, colors].map(({ buffer }) => buffer as ArrayBuffer);
}

/** From all rises along x, then all along y. */
function interleaved(planes: Uint8Array): Int8Array {
  const found = new Int8Array(planes.length);
  const count = planes.length / 2;
  for (let at = 0; at < planes.length; at++) found[at] = planes[(at & 1) * count + (at >> 1)]!;
  return found;
}

function withDistances(codes: Uint8Array, tops: Float32Array, n: number, thresholds: readonly number[]): Uint8Array {
  const found = new Uint8Array((1 + LEAPS) * n * n);
  for (let at = 0; at < codes.length; at++) found[4 * at] = codes[at]!;
  thresholds.forEach((height, k) => writeDistances(tops, n, height, found, 1 + k));
  return found;
}

function sidesOf({ sides, places, normal }: Unfolded, turns: Uint8Array, n: number): Uint8Array {
  const found = new Uint8Array(16 * n * n);
  for (let side = 0; side < normal.length; side++) {
    const told = normal[side]!;
    if (told < 0) continue;
    const to = 4 * ((side & 3) * n * n + (side >> 2));
    for (let part = 0; part < 3; part++) found[to + part] = places[3 * side + part]!;
    found[to + 3] = (OUTWARD[sides[told]! & 3]! + turns[told]!) % TURNS;
  }
  return found;
}
