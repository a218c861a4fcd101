/** Of pictures whose pixels are no wider than the screen's. */
const PICTURE = 0.92;
/** By which pictures twice as coarse are worse. */
const BLUR = 0.055;
/** Of pictures of a few pixels: better than nothing. */
const COARSEST = 0.2;

/** Of a cell's pictures against its geometry, `pitch` pixels of the screen apart; the twin of `farfield.stream.accuracy`. */
export function pictureAccuracy(pitch: number): number {
  return Math.max(PICTURE - BLUR * Math.log2(Math.max(pitch, 1)), COARSEST);
}
