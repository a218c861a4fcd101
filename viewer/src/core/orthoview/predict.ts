/** Prediction of a value from its valid neighbours (spec/orthoview.md, Planes). */

/** The valid pixels of a tile in valid order, and for each where its neighbours stand in that order. */
export interface ValidPixels {
  /** (valid,) column | row << 12. */
  readonly position: Uint32Array;
  /** (valid,) place of the neighbour in valid order, or -1. */
  readonly west: Int32Array;
  readonly north: Int32Array;
  readonly northWest: Int32Array;
}

/**
 * Lists the pixels of a mask (row by row, most significant bit first). Null when it does not mark exactly `valid` pixels
 * or marks some behind the last.
 */
export function validPixels(mask: Uint8Array, width: number, height: number, valid: number): ValidPixels | null {
  const position = new Uint32Array(valid);
  const west = new Int32Array(valid).fill(-1);
  const north = new Int32Array(valid).fill(-1);
  const northWest = new Int32Array(valid).fill(-1);
  // One column to the left of the image saves the test for the border.
  let above = new Int32Array(width + 1).fill(-1);
  let here = new Int32Array(width + 1).fill(-1);
  let count = 0;
  let bit = 0;
  for (let row = 0; row < height; row++) {
    for (let column = 0; column < width; column++, bit++) {
      if ((mask[bit >> 3]! & (128 >> (bit & 7))) === 0) {
        here[column + 1] = -1;
        continue;
      }
      if (count === valid) return null;
      position[count] = column | (row << 12);
      west[count] = here[column]!;
      north[count] = above[column + 1]!;
      northWest[count] = above[column]!;
      here[column + 1] = count++;
    }
    [above, here] = [here, above];
  }
  const behind = bit & 7 ? mask[bit >> 3]! & (255 >> (bit & 7)) : 0;
  return count === valid && behind === 0 ? { position, west, north, northWest } : null;
}

/** Adds predictions to residuals in valid order, in place, modulo `mask` + 1. `first` is predicted for the first. */
export function restore(values: Uint8Array | Uint16Array, pixels: ValidPixels, mask: number, first: number): void {
  const { west, north, northWest } = pixels;
  let previous = first;
  for (let k = 0; k < values.length; k++) {
    const w = west[k]!;
    const n = north[k]!;
    let prediction = previous;
    if (w >= 0 && n >= 0) {
      const a = values[w]!;
      const b = values[n]!;
      const nw = northWest[k]!;
      prediction = nw >= 0 ? edgeDetector(a, b, values[nw]!) : (a + b) >> 1;
    } else if (w >= 0) prediction = values[w]!;
    else if (n >= 0) prediction = values[n]!;
    values[k] = previous = (values[k]! + prediction) & mask;
  }
}

/** The median edge detector. */
function edgeDetector(west: number, north: number, northWest: number): number {
  if (northWest >= Math.max(west, north)) return Math.min(west, north);
  if (northWest <= Math.min(west, north)) return Math.max(west, north);
  return west + north - northWest;
}

/** High bytes, then low bytes of zigzag codes -> 16-bit residuals in two's complement. */
export function unzigzag(bytes: Uint8Array): Uint16Array {
  const count = bytes.length >> 1;
  const residuals = new Uint16Array(count);
  for (let k = 0; k < count; k++) {
    const code = (bytes[k]! << 8) | bytes[count + k]!;
    residuals[k] = (code >> 1) ^ -(code & 1);
  }
  return residuals;
}
