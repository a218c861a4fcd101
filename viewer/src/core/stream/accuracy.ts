/** Of pictures whose pixels are no wider than the screen's. */
const PICTURE = 0.92;
/** By which pictures are worse for each time that they are twice as coarse, and for the square of that. */
const BLUR = [0.03, 0.0065] as const;

/** Of a cell's pictures against its geometry, `pitch` pixels of the screen apart; the twin of `farfield.stream.accuracy`. */
export function pictureAccuracy(pitch: number): number {
  const blur = Math.log2(Math.max(pitch, 1));
  return Math.max(PICTURE - (BLUR[0] + BLUR[1] * blur) * blur, 0);
}
