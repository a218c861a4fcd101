/** The pixels of a tile with a surface, in valid order, and what is beside them (spec/orthoview.md, Planes). */

/** Empty rows above a mask, and columns on both sides: they save the tests for borders. */
export const MARGIN = 2;

/** Bits of `ValidPixels.neighbours`. */
export const WEST = 1;
export const NORTH = 2;
export const NORTH_WEST = 4;
export const NORTH_EAST = 8;

/** The valid pixels of a tile in valid order. */
export interface ValidPixels {
  /** (valid,) column | row << 12. */
  readonly position: Uint32Array;
  /**
   * (valid,) which neighbours are valid, and where they stand in valid order: WEST | NORTH | NORTH_WEST | NORTH_EAST | n << 4. The one
   * north is at n, north-west at n - 1, north-east at `northEastOf`, west right before the pixel. (An array for each
   * takes more time, to allocate and to read.)
   */
  readonly neighbours: Int32Array;
}

/**
 * Lists the pixels of a mask, (MARGIN + height, width + 2 MARGIN) 0 or 1 with empty margins. Null when it does not mark exactly `valid`
 * pixels.
 */
export function validPixels(mask: Uint8Array, width: number, height: number, valid: number): ValidPixels | null {
  const position = new Uint32Array(valid);
  const neighbours = new Int32Array(valid);
  const stride = width + 2 * MARGIN;
  let count = 0;
  for (let row = 0, north = 0; row < height; row++) {
    const first = count;
    for (let column = 0, at = (row + MARGIN) * stride + MARGIN; column < width; column++, at++) {
      const above = at - stride;
      if (mask[at] !== 0) {
        if (count === valid) return null;
        position[count] = column | (row << 12);
        neighbours[count] = mask[at - 1]! | (mask[above]! << 1) | (mask[above - 1]! << 2) | (mask[above + 1]! << 3) | (north << 4);
        count++;
      }
      north += mask[above]!;
    }
    north = first;
  }
  return count === valid ? { position, neighbours } : null;
}

/** Where the neighbour north-east stands in valid order. around: `neighbours` of a pixel that has one. */
export function northEastOf(around: number): number {
  return (around >> 4) + ((around & NORTH) >> 1);
}

/** Depth steps (4 pitches) beyond which a neighbour is not of the same surface. */
const FAR = 32;

/**
 * (valid,) how many of the eight neighbours are less than FAR nearer or farther, | how many of those west, north, east and south are
 * at most FAR farther away << 4; nearer ones count. depths: (valid,).
 */
export function countNear(depths: Uint16Array, { neighbours }: ValidPixels): Uint8Array {
  const near = new Uint8Array(depths.length);
  for (let k = 0; k < depths.length; k++) {
    const around = neighbours[k]!;
    const north = around >> 4;
    const depth = depths[k]!;
    let own = 0;
    if (around & WEST) {
      const step = depths[k - 1]! - depth;
      own += isNear(step) + isBeside(step);
      near[k - 1]! += isNear(step) + isBeside(-step);
    }
    if (around & NORTH) {
      const step = depths[north]! - depth;
      own += isNear(step) + isBeside(step);
      near[north]! += isNear(step) + isBeside(-step);
    }
    if (around & NORTH_WEST) {
      const both = isNear(depths[north - 1]! - depth);
      own += both;
      near[north - 1]! += both;
    }
    if (around & NORTH_EAST) {
      const other = northEastOf(around);
      const both = isNear(depths[other]! - depth);
      own += both;
      near[other]! += both;
    }
    near[k] = own;
  }
  return near;
}

/** 1 for a neighbour so much farther away when that is less than FAR, or nearer. By signs: a branch is guessed wrong too often. */
function isNear(step: number): number {
  return ((step - FAR) & (-FAR - step)) >>> 31;
}

/** 1 << 4 for one that is at most FAR farther away, or nearer. */
function isBeside(step: number): number {
  return ((step - FAR - 1) >>> 31) << 4;
}
