/** Values from residuals (spec/orthoview.md, Prediction). */
import { NORTH, NORTH_EAST, NORTH_WEST, northEastOf, WEST, type ValidPixels } from "./valid.js";

/** Furthest apart that three depths may be to lie on a plane. */
const PLANE_SPREAD = 32;

/** Adds the predictions of depth to residuals in valid order, in place. */
export function restoreDepth(values: Uint16Array, { neighbours }: ValidPixels): void {
  let previous = 0; // The value west, where there is one.
  for (let k = 0; k < values.length; k++) {
    const around = neighbours[k]!;
    let prediction = previous;
    if (around & NORTH) {
      const north = values[around >> 4]!;
      if (!(around & WEST)) prediction = north;
      else prediction = around & NORTH_WEST ? planeOrEdge(previous, north, values[(around >> 4) - 1]!) : (previous + north) >> 1;
    }
    values[k] = previous = (values[k]! + prediction) & 0xffff;
  }
}

/** Further apart than two depths can be. */
const NOWHERE = 1 << 20;

/**
 * Adds the predictions of both normal coordinates to residuals in valid order, in place. A neighbour counts when its depth is about as
 * near as the nearest neighbour's: then it lies on the same surface.
 */
export function restoreNormals(a: Uint8Array, b: Uint8Array, depths: Uint16Array, { neighbours }: ValidPixels): void {
  let [previousA, previousB] = [32, 32]; // The codes west, where there are some.
  for (let k = 0; k < depths.length; k++) {
    const around = neighbours[k]!;
    const north = around >> 4;
    const northEast = northEastOf(around);
    const depth = depths[k]!;
    const dw = around & WEST ? Math.abs(depths[k - 1]! - depth) : NOWHERE;
    const dn = around & NORTH ? Math.abs(depths[north]! - depth) : NOWHERE;
    const dnw = around & NORTH_WEST ? Math.abs(depths[north - 1]! - depth) : NOWHERE;
    const dne = around & NORTH_EAST ? Math.abs(depths[northEast]! - depth) : NOWHERE;
    const most = 2 * Math.min(dw, dn, dnw, dne) + 8;
    let [predictionA, predictionB] = [previousA, previousB];
    if (dw <= most && dn <= most && most < NOWHERE) {
      if (dnw <= most) {
        predictionA = edgeDetector(previousA, a[north]!, a[north - 1]!);
        predictionB = edgeDetector(previousB, b[north]!, b[north - 1]!);
      } else {
        predictionA = (previousA + a[north]!) >> 1;
        predictionB = (previousB + b[north]!) >> 1;
      }
    } else if (dw > most) {
      const alone = dn <= most ? north : dnw <= most ? north - 1 : northEast;
      predictionA = a[alone]!;
      predictionB = b[alone]!;
    }
    a[k] = previousA = (a[k]! + predictionA) & 63;
    b[k] = previousB = (b[k]! + predictionB) & 63;
  }
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

/** Zigzag codes -> 16-bit residuals in two's complement. */
export function unzigzag(zigzags: Uint16Array): Uint16Array {
  const residuals = new Uint16Array(zigzags.length);
  for (let k = 0; k < zigzags.length; k++) residuals[k] = (zigzags[k]! >> 1) ^ -(zigzags[k]! & 1);
  return residuals;
}
