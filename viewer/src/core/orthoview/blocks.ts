import { WORDS } from "./words.js";

/** Blocks are 32 pitches along each edge before small ones are joined: 5 bits of column and row, and the low byte of depth. */
const EDGE_BITS = 5;
const SLABS = 256;
/** Pixels below which a block goes on into the next slab of depth: fewer, and testing it costs more than drawing it. */
const LEAST = 64;
/** Pitches that a footprint reaches beyond the middle of its pixel within the picture's plane: 1/√2. */
const REACH = Math.SQRT1_2;
/** As the vertex shader limits the slope of a footprint. */
const STEEPEST = 4;

/** Numbers of a block in `Blocks.boxes` and `Blocks.cones`. */
export const BOX = 6;
export const CONE = 5;

/** Runs of a tile's pixels that lie close together: what is drawn or left out as a whole. */
export interface Blocks {
  readonly count: number;
  /** (count + 1,) first pixel of each, and the end of the last. */
  readonly starts: Uint32Array;
  /**
   * (count, 6) lower and upper u, v, w of all that the splats touch: pitches from the tile's first column and row, and
   * from depth code 0.
   */
  readonly boxes: Float32Array;
  /**
   * (count, 5) axis, cosine and sine of half the angle of a cone of all normals, in the tile's frame; the half angle is 90° where
   * pixels are drawn from both sides.
   */
  readonly cones: Float32Array;
}

/**
 * Puts pixels (as of DecodedTile) in order of blocks: cubes of 32 pitches, in which they keep their order. Depth divides
 * too, because a square of a view from the side may show a wall and what lies half a kilometre behind it.
 */
export function orderInBlocks(pixels: Uint32Array, width: number): { pixels: Uint32Array; blocks: Blocks } {
  const across = (width + (1 << EDGE_BITS) - 1) >> EDGE_BITS;
  const squareOf = (at: number): number => ((pixels[at]! >>> (12 + EDGE_BITS)) & 127) * across + ((pixels[at]! & 4095) >> EDGE_BITS);
  const slabOf = (at: number): number => pixels[at + 1]! >>> 24;
  const squares = across * 128;
  const order = sorted(sorted(identity(pixels.length / WORDS), slabOf, SLABS), squareOf, squares);
  const ordered = new Uint32Array(pixels.length);
  const builder = new Builder();
  let last = -1;
  for (let k = 0; k < order.length; k++) {
    const from = order[k]! * WORDS;
    const place = squareOf(from) * SLABS + slabOf(from);
    const same = Math.floor(place / SLABS) === Math.floor(last / SLABS);
    if (k > 0 && place !== last && (!same || k - builder.start >= LEAST)) builder.close(ordered, k);
    last = place;
    for (let n = 0; n < WORDS; n++) ordered[k * WORDS + n] = pixels[from + n]!;
  }
  builder.close(ordered, order.length);
  return { pixels: ordered, blocks: builder.blocks };
}

function identity(count: number): Uint32Array {
  const order = new Uint32Array(count);
  for (let k = 0; k < count; k++) order[k] = k;
  return order;
}

/** An order sorted by a number below `most` of each pixel's place in words; equal ones stay as they are. */
function sorted(order: Uint32Array, numberOf: (at: number) => number, most: number): Uint32Array {
  const ends = new Uint32Array(most + 1);
  for (const k of order) ends[numberOf(k * WORDS) + 1]!++;
  for (let n = 0; n < most; n++) ends[n + 1]! += ends[n]!;
  const result = new Uint32Array(order.length);
  for (const k of order) result[ends[numberOf(k * WORDS)]!++] = k;
  return result;
}

/** Describes one run of pixels after the other. */
class Builder {
  start = 0;
  private readonly starts = [0];
  private readonly boxes: number[] = [];
  private readonly cones: number[] = [];

  get blocks(): Blocks {
    const { starts, boxes, cones } = this;
    return {
      count: starts.length - 1,
      starts: Uint32Array.from(starts),
      boxes: Float32Array.from(boxes),
      cones: Float32Array.from(cones),
    };
  }

  /** Ends the present run before pixel `end`. */
  close(pixels: Uint32Array, end: number): void {
    const cone = coneOf(pixels, this.start, end);
    this.boxes.push(...boxOf(pixels, this.start, end));
    this.cones.push(...cone);
    this.starts.push(end);
    this.start = end;
  }
}

function boxOf(pixels: Uint32Array, start: number, end: number): number[] {
  let [left, right, top, bottom, front, back, steepest] = [4096, 0, 4096, 0, 0xffff, 0, 0];
  for (let k = start, at = start * WORDS; k < end; k++, at += WORDS) {
    const [place, color, surface] = [pixels[at]!, pixels[at + 1]!, pixels[at + 2]!];
    const [column, row] = [place & 4095, (place >>> 12) & 4095];
    const depth = (place >>> 24) | ((color >>> 24) << 8);
    left = Math.min(left, column);
    right = Math.max(right, column);
    top = Math.min(top, row);
    bottom = Math.max(bottom, row);
    front = Math.min(front, depth);
    back = Math.max(back, depth);
    if (isConnected(surface)) steepest = Math.max(steepest, SLOPES[surface & 4095]!);
  }
  const [side, deep] = [REACH - 0.5, REACH * Math.max(1, steepest)];
  return [left - side, top - side, front / 8 - deep, right + 1 + side, bottom + 1 + side, back / 8 + deep];
}

function isConnected(surface: number): boolean {
  return (surface & 0x80000) !== 0;
}

const BOTH_SIDES = [0, 0, -1, 0, 1];

function coneOf(pixels: Uint32Array, start: number, end: number): number[] {
  let [x, y, z] = [0, 0, 0];
  for (let at = start * WORDS + 2; at < end * WORDS; at += WORDS) {
    if (!isConnected(pixels[at]!)) return BOTH_SIDES;
    const n = (pixels[at]! & 4095) * 3;
    x += NORMALS[n]!;
    y += NORMALS[n + 1]!;
    z += NORMALS[n + 2]!;
  }
  const length = Math.sqrt(x * x + y * y + z * z);
  [x, y, z] = [x / length, y / length, z / length];
  let cosine = 1;
  for (let at = start * WORDS + 2; at < end * WORDS; at += WORDS) {
    const n = (pixels[at]! & 4095) * 3;
    cosine = Math.min(cosine, x * NORMALS[n]! + y * NORMALS[n + 1]! + z * NORMALS[n + 2]!);
  }
  return cosine > 0 ? [x, y, z, cosine, Math.sqrt(1 - cosine * cosine)] : BOTH_SIDES;
}

/** (4096, 3) unit normals by their code, and (4096,) how steeply a connected footprint of each is drawn; as the vertex shader has them. */
const NORMALS = new Float64Array(4096 * 3);
const SLOPES = new Float64Array(4096);
for (let code = 0; code < 4096; code++) {
  const [s, t] = [((code & 63) * 2) / 63 - 1, ((code >> 6) * 2) / 63 - 1];
  const [x, y] = [(s + t) / 2, (s - t) / 2];
  const z = -Math.max(0, 1 - Math.abs(x) - Math.abs(y));
  const length = Math.sqrt(x * x + y * y + z * z);
  NORMALS.set([x / length, y / length, z / length], code * 3);
  const below = Math.min(z / length, -0.001);
  const limited = (part: number): number => Math.max(-STEEPEST, Math.min(STEEPEST, -part / length / below));
  SLOPES[code] = Math.sqrt(limited(x) ** 2 + limited(y) ** 2);
}
