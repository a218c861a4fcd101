/** Of pictures whose pixels are no wider than the screen's. */
const PICTURE = 0.95;
/** By which pictures twice as coarse are worse. */
export const BLUR = 0.1;

/** Of a cell's pictures against its geometry, `pitch` pixels of the screen apart; the twin of `farfield.stream.accuracy`. */
export function pictureAccuracy(pitch: number): number {
  return PICTURE / (1 + BLUR * Math.log2(Math.max(pitch, 1)));
}
