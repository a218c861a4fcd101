import { ERROR_SPACING, FARTHEST } from "../indextile.js";

/** Errors of pictures in worlds that do not tell them. */
const UNTOLD = [0.08, 0.12, 0.23] as const;
/** By which pictures are worse at least for each ERROR_SPACING times that they are coarser than what is told. */
const LEAST_STEP = 0.05;

/** What is lost by a cell's pictures in the place of a child's, in worlds that do not tell. */
export const UNTOLD_LOSS = 0.12;
/** See `lossFrom`. */
const LOST = 0.4;
const LEAST_LOST = 0.2;

/** Of what is lost by a cell's pictures, `pitch` pixels of the screen apart, in the place of a child's: what shows of it. */
export function lossFrom(loss: number, pitch: number): number {
  return loss * Math.min(Math.max(LOST * Math.log2(Math.max(pitch, 1e-9)) + 1 - LOST, LEAST_LOST), 1);
}

/** Three errors, 0 to 1; what is told for fewer views goes on as it ends. */
export function toldBy(errors: readonly number[] | undefined): readonly number[] {
  return errors?.length ? [0, 1, 2].map((n) => errors[Math.min(n, errors.length - 1)]! / 255) : UNTOLD;
}

/** Of a cell's pictures against its geometry, `pitch` pixels of the screen apart; the twin of `farfield.stream.accuracy`. */
export function pictureAccuracy([first, second, third]: readonly number[], pitch: number): number {
  const at = Math.log(Math.max(FARTHEST * pitch, 1)) / Math.log(ERROR_SPACING);
  const beyond = third! + Math.max(third! - second!, LEAST_STEP) * (at - 2);
  const within = at < 1 ? first! + (second! - first!) * at : second! + (third! - second!) * (at - 1);
  return Math.max(1 - (at > 2 ? beyond : within), 0);
}
