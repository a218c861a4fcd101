import { BOX } from "./blocks.js";
import type { DecodedTile } from "./decode.js";
import { WORDS } from "./words.js";

/** Pixels along a side of a patch, largest first. Larger ones save few points more, and up close would be wider than cards draw points. */
const EDGES = [8, 4, 2] as const;
/** Pixels along a side of a block (blocks.ts): patches do not reach beyond one. */
const SIDE = 32;
/** Depth codes, eighths of a pitch, that pixels of a patch lie off its plane at most. */
export const OFF_PLANE = 2;
/** Depth codes a pixel that a patch rises at most, as footprints do. */
const STEEPEST = 32;
/** Steps of a patch's slopes: so many in a depth code a pixel. */
const SLOPE_STEPS = 16;
/** Pitches that a patch reaches beyond its pixels, so that no gap is left between it and what goes on in another slope (splat.vert.glsl). */
export const PATCH_MARGIN = 0.1;
/** Coverage 16, connected. */
const WHOLE = (15 << 12) | 0x80000;

/** Words of a texel: color, then surface as in DecodedTile.pixels. */
export const TEXEL_WORDS = 2;

/**
 * Joins connected, full pixels that lie in a plane to square patches: a façade of 10,000 splats is some 200 points then, each of which looks
 * its pixels up. A patch takes the place of a pixel, with bit 31 of its third word:
 *
 *     first column 12, first row 12, depth of its middle 8 (low)
 *     first texel / 4 24, depth of its middle 8 (high)
 *     slope along u 11, along v 11 (1/16 code a pixel, from -1024), log2 of its edge - 1 2, half a code deeper 1, ..., 1
 *
 * Blocks stay as they are, but that they count points. Texels of a patch are in rows.
 */
export function joinPatches(tile: DecodedTile): DecodedTile {
  const { pixels, blocks } = tile;
  const points = new Uint32Array(pixels.length);
  const texels = new Uint32Array((pixels.length / WORDS) * TEXEL_WORDS);
  const starts = new Uint32Array(blocks.count + 1);
  const boxes = blocks.boxes.slice();
  const square = new Square(pixels, points, texels);
  for (let n = 0; n < blocks.count; n++) {
    square.join(blocks.starts[n]!, blocks.starts[n + 1]!, boxes.subarray(n * BOX, n * BOX + BOX));
    starts[n + 1] = square.points / WORDS;
  }
  return {
    ...tile,
    count: square.points / WORDS,
    pixels: points.slice(0, square.points),
    texels: texels.slice(0, square.texels),
    blocks: { ...blocks, starts, boxes },
  };
}

/** Joins the pixels of one block after the other. */
class Square {
  /** Words written so far. */
  points = 0;
  texels = 0;
  /** Where in `pixels` that of each place begins; -1: it is not there, or part of a patch already. */
  private readonly at = new Int32Array(SIDE * SIDE);

  constructor(
    private readonly from: Uint32Array,
    private readonly to: Uint32Array,
    private readonly texelsTo: Uint32Array,
  ) {}

  join(start: number, end: number, box: Float32Array): void {
    const { from, at } = this;
    at.fill(-1);
    for (let k = start * WORDS; k < end * WORDS; k += WORDS) {
      if ((from[k + 2]! & WHOLE) === WHOLE) at[placeOf(from[k]!)] = k;
    }
    for (const edge of EDGES) {
      for (let row = 0; row < SIDE; row += edge) {
        for (let column = 0; column < SIDE; column += edge) this.patch(row * SIDE + column, edge, box);
      }
    }
    for (let k = start * WORDS; k < end * WORDS; k += WORDS) {
      const place = placeOf(from[k]!);
      // Part of a patch already.
      if ((from[k + 2]! & WHOLE) === WHOLE && at[place] !== k) continue;
      for (let n = 0; n < WORDS; n++) this.to[this.points++] = from[k + n]!;
    }
  }

  /** Makes a patch of the pixels from a place on, if they are all there and in a plane. */
  private patch(first: number, edge: number, box: Float32Array): void {
    const { from, at } = this;
    const middle = (edge - 1) / 2;
    let [sum, alongU, alongV] = [0, 0, 0];
    for (let j = 0; j < edge; j++) {
      for (let i = 0; i < edge; i++) {
        const k = at[first + j * SIDE + i]!;
        if (k < 0) return;
        const depth = depthOf(from, k);
        sum += depth;
        alongU += (i - middle) * depth;
        alongV += (j - middle) * depth;
      }
    }
    // Sum of the squares of the offsets, over the patch.
    const squares = (edge * edge * (edge * edge - 1)) / 12;
    const [a, b] = [steps(alongU / squares), steps(alongV / squares)];
    const twice = Math.round((2 * sum) / (edge * edge));
    if (Math.abs(a) > STEEPEST * SLOPE_STEPS || Math.abs(b) > STEEPEST * SLOPE_STEPS) return;
    for (let j = 0; j < edge; j++) {
      for (let i = 0; i < edge; i++) {
        const plane = twice / 2 + ((i - middle) * a + (j - middle) * b) / SLOPE_STEPS;
        if (Math.abs(depthOf(from, at[first + j * SIDE + i]!) - plane) > OFF_PLANE) return;
      }
    }
    this.write(first, edge, twice, a, b);
    const reach = ((edge / 2 + PATCH_MARGIN) * (Math.abs(a) + Math.abs(b))) / SLOPE_STEPS;
    box[2] = Math.min(box[2]!, (twice / 2 - reach) / 8);
    box[5] = Math.max(box[5]!, (twice / 2 + reach) / 8);
  }

  private write(first: number, edge: number, twice: number, a: number, b: number): void {
    const { from, to, at, texelsTo } = this;
    const [depth, half] = [twice >> 1, twice & 1];
    to[this.points++] = (from[at[first]!]! & 0xffffff) | ((depth & 255) << 24);
    to[this.points++] = (this.texels / TEXEL_WORDS / 4) | ((depth >> 8) << 24);
    to[this.points++] = (a + 1024) | ((b + 1024) << 11) | ((Math.log2(edge) - 1) << 22) | (half << 24) | 0x80000000;
    for (let j = 0; j < edge; j++) {
      for (let i = 0; i < edge; i++) {
        const place = first + j * SIDE + i;
        const k = at[place]!;
        texelsTo[this.texels++] = from[k + 1]! & 0xffffff;
        texelsTo[this.texels++] = from[k + 2]!;
        at[place] = -1;
      }
    }
  }
}

function placeOf(word: number): number {
  return ((word >>> 12) & (SIDE - 1)) * SIDE + (word & (SIDE - 1));
}

function depthOf(pixels: Uint32Array, k: number): number {
  return (pixels[k]! >>> 24) | ((pixels[k + 1]! >>> 24) << 8);
}

function steps(slope: number): number {
  return Math.round(slope * SLOPE_STEPS);
}
