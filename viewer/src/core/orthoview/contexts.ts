/**
 * Coded planes of a tile: their symbols, and the context that tells the probabilities of each (spec/orthoview.md, Codec 3). Numbers are
 * per valid pixel, in valid order. Whether a plane held what it should, its reader knows when it has been read.
 */
import { SymbolReader, type Model } from "./coding.js";
import { MARGIN, NORTH, NORTH_EAST, NORTH_WEST, northEastOf, WEST, type ValidPixels } from "./valid.js";

const MASK_CONTEXTS = 128;
const FIRST_CONTEXTS = 16;
const COVERAGE_CONTEXTS = 48;
export const DEPTH_MODELS: readonly Model[] = [{ contexts: MASK_CONTEXTS, alphabet: 2 }, { contexts: 96, alphabet: 40 }];
export const NORMAL_MODELS: readonly Model[] = [{ contexts: FIRST_CONTEXTS + 48, alphabet: 64 }];
export const COVERAGE_MODELS: readonly Model[] = [{ contexts: COVERAGE_CONTEXTS, alphabet: 16 }, { contexts: 40, alphabet: 8 }];
export const BIT_MODELS: readonly Model[] = [{ contexts: 144, alphabet: 2 }];
const OBJECT_CONTEXTS = 32;
export const OBJECT_MODELS: readonly Model[] = [{ contexts: OBJECT_CONTEXTS, alphabet: 5 }, { contexts: 1, alphabet: 33 }];
/** In place of a neighbour: none shows the same object, and its id follows. */
const NONE = 4;

/** (size,) of every number below `size`, how many limits are not above it. */
function steps(size: number, ...limits: number[]): Uint8Array {
  return Uint8Array.from({ length: size }, (_, number) => limits.filter((limit) => limit <= number).length);
}

const DEPTH_STEPS = steps(6 * 255 + 1, 1, 2, 4, 6, 9, 12, 16, 22, 30, 42, 60, 90, 150, 300, 800);
const NORMAL_STEPS = steps(6 * 64 + 4 * 32 + 1, 1, 3, 6, 9, 13, 18, 24, 32, 42, 56, 75, 100, 140, 200, 280);
const TURN_STEPS = steps(64 + 1, 1, 3, 6, 12);
const LENGTH_STEPS = steps(2 * 7 + 1, 8, 12, 14);
/** Residuals of depth below this are a symbol each. */
const SMALL = 16;
/** (64,) how large each residual of a normal is. */
const TURN_SIZES = Uint8Array.from({ length: 64 }, (_, residual) => Math.min(residual, 64 - residual));
/** (64,) where the contexts of the second begin, by the first. */
const SECOND_CONTEXTS = Uint8Array.from({ length: 64 }, (_, first) => FIRST_CONTEXTS + 16 * (first === 0 ? 1 : first < 32 ? 2 : 0));
/** Coverage - 1 of a full pixel. */
const FULL = 15;
/** In place of a neighbour's code of coverage and length: as if its normal were 8 long, with a coverage that none has. */
const MISSING = (16 << 3) | 7;
/** (17,) by a neighbour's coverage - 1 how much of its pixel it fills: 3 a half or less, 2 more, 1 all, 0 nothing there. */
const FILLED = steps(17, 8, FULL, FULL + 1).map((step) => 3 - step);

/** The mask: (MARGIN + height, width + 2 MARGIN) 0 or 1 with empty margins. */
export function readMask(reader: SymbolReader, width: number, height: number): Uint8Array {
  const stride = width + 2 * MARGIN;
  const mask = new Uint8Array((height + MARGIN) * stride);
  for (let row = MARGIN; row < height + MARGIN; row++) {
    let at = row * stride + MARGIN;
    // Bits of the context from the lowest: W, N, NW, NE, WW, NN, NEE. From pixel to pixel all but two are known, one farther west.
    let context = (mask[at - stride]! << 1) | (mask[at - stride + 1]! << 3);
    for (const end = at + width; at < end; at++) {
      context |= (mask[at - 2 * stride]! << 5) | (mask[at - stride + 2]! << 6);
      const bit = reader.symbol(context);
      mask[at] = bit;
      context = bit | ((context & 1) << 4) | ((context & 2) << 1) | ((context & 8) >> 2) | ((context & 64) >> 3);
    }
  }
  return mask;
}

/** Residuals of depth as zigzag codes; they follow the mask. */
export function readDepth(reader: SymbolReader, { neighbours }: ValidPixels): Uint16Array {
  const zigzags = new Uint16Array(neighbours.length);
  const sizes = new Uint8Array(neighbours.length);
  for (let k = 0; k < zigzags.length; k++) {
    const around = neighbours[k]!;
    const north = around & NORTH ? zigzags[around >> 4]! : 0;
    // 2 positive, 0 negative, 1 zero; a branch would be guessed wrong too often.
    const sign = 2 - 2 * (north & 1) - ((north - 1) >>> 31);
    const both = around & WEST && around & NORTH ? 16 : 0;
    let z = reader.symbol(MASK_CONTEXTS + (both + DEPTH_STEPS[meanAround(sizes, around, k, 1)]!) * 3 + sign);
    if (z >= SMALL) {
      const more = ((z - SMALL) >> 1) + 3;
      z = 2 | (z & 1);
      if (more > 7) z = (z << (more - 7)) | reader.bits(more - 7);
      z = (z << Math.min(more, 7)) | reader.bits(Math.min(more, 7));
    }
    zigzags[k] = z;
    sizes[k] = depthSize(z);
  }
  return zigzags;
}

/** Residuals of the normals: (valid,) 0..63 of each coordinate. */
export type Turns = readonly [first: Uint8Array, second: Uint8Array];

/** Those; zigzags: of `readDepth`. */
export function readNormals(reader: SymbolReader, { neighbours }: ValidPixels, zigzags: Uint16Array): Turns {
  const count = zigzags.length;
  const [first, second, sizes] = [new Uint8Array(count), new Uint8Array(count), new Uint8Array(count)];
  // Seen from above, all of a city's are 0: a tenth of the time for a tile.
  if (reader.only !== null) return [first.fill(reader.only), second.fill(reader.only)];
  for (let k = 0; k < count; k++) {
    const turn = meanAround(sizes, neighbours[k]!, k, 12);
    const a = reader.symbol(NORMAL_STEPS[turn + 2 * Math.min(32, depthSize(zigzags[k]!))]!);
    const b = reader.symbol(SECOND_CONTEXTS[a]! + NORMAL_STEPS[turn + 4 * TURN_SIZES[a]!]!);
    first[k] = a;
    second[k] = b;
    sizes[k] = TURN_SIZES[a]! + TURN_SIZES[b]!;
  }
  return [first, second];
}

/** Coverage - 1 times 8 and length - 1. near: of `countNear`. */
export function readCoverage(reader: SymbolReader, pixels: ValidPixels, near: Uint8Array, [first, second]: Turns): Uint8Array {
  const { neighbours } = pixels;
  const codes = new Uint8Array(near.length);
  for (let k = 0; k < codes.length; k++) {
    const around = neighbours[k]!;
    const west = around & WEST ? codes[k - 1]! : MISSING;
    const north = around & NORTH ? codes[around >> 4]! : MISSING;
    const open = Math.min(2, 4 - (near[k]! >> 4));
    const coverage = reader.symbol(16 * open + 4 * FILLED[west >> 3]! + FILLED[north >> 3]!);
    const turn = TURN_STEPS[TURN_SIZES[first[k]!]! + TURN_SIZES[second[k]!]!]!;
    const full = coverage === FULL ? 1 : 0;
    const length = reader.symbol(COVERAGE_CONTEXTS + (2 * turn + full) * 4 + LENGTH_STEPS[(west & 7) + (north & 7)]!);
    codes[k] = (coverage << 3) | length;
  }
  return codes;
}

/** A bit a pixel. near: of `countNear`. */
export function readBits(reader: SymbolReader, { neighbours }: ValidPixels, near: Uint8Array): Uint8Array {
  const bits = new Uint8Array(near.length);
  for (let k = 0; k < bits.length; k++) {
    const around = neighbours[k]!;
    const north = around >> 4;
    let context = (near[k]! & 15) << 4;
    if (around & WEST) context |= bits[k - 1]!;
    if (around & NORTH) context |= bits[north]! << 1;
    if (around & NORTH_WEST) context |= bits[north - 1]! << 2;
    if (around & NORTH_EAST) context |= bits[northEastOf(around)]! << 3;
    bits[k] = reader.symbol(context);
  }
  return bits;
}

/** Object ids; null when a neighbour is named that is not there. */
export function readObjects(reader: SymbolReader, { neighbours }: ValidPixels): Uint32Array | null {
  const ids = new Uint32Array(neighbours.length);
  let last = 0;
  for (let k = 0; k < ids.length; k++) {
    const around = neighbours[k]!;
    const others = [k - 1, around >> 4, (around >> 4) - 1, northEastOf(around)] as const;
    const side = reader.symbol(objectContext(around, others, ids));
    if (side === NONE) ids[k] = last = (last + readStep(reader)) >>> 0;
    else if ((around >> side) & 1) ids[k] = ids[others[side]!]!;
    else return null;
  }
  return ids;
}

/** Which neighbours there are, and which show the same object. others: where those west, north, north-west and north-east stand. */
function objectContext(around: number, [west, north, northWest, northEast]: readonly [number, number, number, number], ids: Uint32Array): number {
  let context = around & (WEST | NORTH);
  if (!(around & NORTH)) return context;
  const id = ids[north]!;
  if (around & WEST && ids[west] === id) context |= 4;
  if (around & NORTH_WEST && ids[northWest] === id) context |= 8;
  if (around & NORTH_EAST && ids[northEast] === id) context |= 16;
  return context;
}

/** How far an id is from the last that was written: a zigzag code of as many bits as are told first. */
function readStep(reader: SymbolReader): number {
  const length = reader.symbol(OBJECT_CONTEXTS);
  let code = length > 0 ? 1 : 0;
  for (let bits = length - 1; bits > 0; ) {
    const part = Math.min(bits, 7);
    bits -= part;
    // Of up to 32 bits: shifts would take the highest for a sign.
    code = code * 2 ** part + reader.bits(part);
  }
  return code % 2 === 0 ? code / 2 : -(code + 1) / 2;
}

/** Mean of the neighbours' numbers in sixths; `alone` when the pixel has none before it. around: its `neighbours`. */
function meanAround(numbers: Uint8Array, around: number, k: number, alone: number): number {
  const north = around >> 4;
  if ((around & 15) === 15) return 2 * (numbers[k - 1]! + numbers[north]!) + numbers[north - 1]! + numbers[north + 1]!;
  let sum = 0;
  let weight = 0;
  if (around & WEST) {
    sum += 2 * numbers[k - 1]!;
    weight += 2;
  }
  if (around & NORTH) {
    sum += 2 * numbers[north]!;
    weight += 2;
  }
  if (around & NORTH_WEST) {
    sum += numbers[north - 1]!;
    weight++;
  }
  if (around & NORTH_EAST) {
    sum += numbers[northEastOf(around)]!;
    weight++;
  }
  return weight === 0 ? alone : Math.floor((6 * sum) / weight);
}

/** How large a residual of depth is, by its zigzag code. */
function depthSize(zigzag: number): number {
  return Math.min(255, (zigzag + 1) >> 1);
}
