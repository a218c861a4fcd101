/** The mask of a tile, and values from residuals (spec/orthoview.md, Planes and Prediction). */

/** The valid pixels of a tile in valid order, and for each where its neighbours stand in that order. */
export interface ValidPixels {
  /** (valid,) column | row << 12. */
  readonly position: Uint32Array;
  /** (valid,) place of the neighbour in valid order, or -1. */
  readonly west: Int32Array;
  readonly north: Int32Array;
  readonly northWest: Int32Array;
  readonly northEast: Int32Array;
}

/**
 * Lists the pixels of a mask: row by row, most significant bit first, each bit combined by exclusive or with the one above.
 * Null when it does not mark exactly `valid` pixels.
 */
export function validPixels(mask: Uint8Array, width: number, height: number, valid: number): ValidPixels | null {
  const position = new Uint32Array(valid);
  const none = (): Int32Array => new Int32Array(valid).fill(-1);
  const [west, north, northWest, northEast] = [none(), none(), none(), none()];
  // A column more on both sides of the image saves the tests for the border.
  let above = new Int32Array(width + 2).fill(-1);
  let here = new Int32Array(width + 2).fill(-1);
  let count = 0;
  let bit = 0;
  for (let row = 0; row < height; row++) {
    for (let column = 1; column <= width; column++, bit++) {
      const stored = (mask[bit >> 3]! & (128 >> (bit & 7))) !== 0;
      if (stored === above[column]! >= 0) {
        here[column] = -1;
        continue;
      }
      if (count === valid) return null;
      position[count] = (column - 1) | (row << 12);
      west[count] = here[column - 1]!;
      north[count] = above[column]!;
      northWest[count] = above[column - 1]!;
      northEast[count] = above[column + 1]!;
      here[column] = count++;
    }
    [above, here] = [here, above];
  }
  return count === valid ? { position, west, north, northWest, northEast } : null;
}

/** Furthest apart that three depths may be to lie on a plane. */
const PLANE_SPREAD = 32;

/** Adds the predictions of depth to residuals in valid order, in place. */
export function restoreDepth(values: Uint16Array, { west, north, northWest }: ValidPixels): void {
  let previous = 0;
  for (let k = 0; k < values.length; k++) {
    const [w, n, nw] = [west[k]!, north[k]!, northWest[k]!];
    let prediction = previous;
    if (w >= 0 && n >= 0) {
      const [a, b] = [values[w]!, values[n]!];
      prediction = nw >= 0 ? planeOrEdge(a, b, values[nw]!) : (a + b) >> 1;
    } else if (w >= 0) prediction = values[w]!;
    else if (n >= 0) prediction = values[n]!;
    values[k] = previous = (values[k]! + prediction) & 0xffff;
  }
}

/** Where the neighbours that predict a pixel's normal stand in valid order; -1: it does not count. */
interface Counting {
  readonly west: Int32Array;
  readonly north: Int32Array;
  readonly northWest: Int32Array;
  /** The only one that predicts, where the three do not; -2: the previous in valid order. */
  readonly alone: Int32Array;
}

const PREVIOUS = -2;

/** Adds the predictions of both normal coordinates to residuals in valid order, in place. */
export function restoreNormals(a: Uint8Array, b: Uint8Array, depths: Uint16Array, pixels: ValidPixels): void {
  const counting = countNeighbours(depths, pixels);
  for (const codes of [a, b]) restoreCodes(codes, counting);
}

function restoreCodes(codes: Uint8Array, { west, north, northWest, alone }: Counting): void {
  let previous = 32;
  for (let k = 0; k < codes.length; k++) {
    let prediction = previous;
    const single = alone[k]!;
    if (single >= 0) prediction = codes[single]!;
    else if (single !== PREVIOUS) {
      const [a, b, nw] = [codes[west[k]!]!, codes[north[k]!]!, northWest[k]!];
      prediction = nw >= 0 ? edgeDetector(a, b, codes[nw]!) : (a + b) >> 1;
    }
    codes[k] = previous = (codes[k]! + prediction) & 63;
  }
}

/** A neighbour counts when its depth is about as near as the nearest neighbour's: then it lies on the same surface. */
function countNeighbours(depths: Uint16Array, pixels: ValidPixels): Counting {
  const count = depths.length;
  const [west, north, northWest] = [new Int32Array(count), new Int32Array(count), new Int32Array(count)];
  const alone = new Int32Array(count).fill(-1);
  const FAR = 1 << 20;
  for (let k = 0; k < count; k++) {
    const depth = depths[k]!;
    const [w, n, nw, ne] = [pixels.west[k]!, pixels.north[k]!, pixels.northWest[k]!, pixels.northEast[k]!];
    const dw = w >= 0 ? Math.abs(depths[w]! - depth) : FAR;
    const dn = n >= 0 ? Math.abs(depths[n]! - depth) : FAR;
    const dnw = nw >= 0 ? Math.abs(depths[nw]! - depth) : FAR;
    const dne = ne >= 0 ? Math.abs(depths[ne]! - depth) : FAR;
    const least = Math.min(dw, dn, dnw, dne);
    if (least === FAR) {
      alone[k] = PREVIOUS;
      continue;
    }
    const most = 2 * least + 8;
    if (dw <= most && dn <= most) {
      west[k] = w;
      north[k] = n;
      northWest[k] = dnw <= most ? nw : -1;
    } else alone[k] = dw <= most ? w : dn <= most ? n : dnw <= most ? nw : ne;
  }
  return { west, north, northWest, alone };
}

function planeOrEdge(west: number, north: number, northWest: number): number {
  const spread = Math.max(west, north, northWest) - Math.min(west, north, northWest);
  return spread <= PLANE_SPREAD ? west + north - northWest : edgeDetector(west, north, northWest);
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
