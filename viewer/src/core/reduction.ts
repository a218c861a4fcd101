/** What can be less, so that a frame takes less time. */
export interface Reducible {
  readonly supersampling: number;
  readonly views: number | null;
  readonly leastGain: number;
  readonly layers: number;
  readonly bias: number;
}

/** The greatest reduction. */
export const MOST_REDUCTION = 5;
/** In steps: from one to the next the picture changes little. */
export const REDUCTION_STEP = 0.25;

const LESS_GAIN = 4;
const FEWER_VIEWS = 2;
const MORE_BIAS = 1;

/**
 * Less than what is asked for; 0 is all of it. Each 1 takes about half the work away, first what is missed least: samples a pixel (0 to
 * 1), directions and layers (1 to 2), resolution of the cells (2 to 4), and pixels of the frame, half of them a side in the end (4 to
 * 5).
 */
export function reduced<T extends Reducible>(asked: T, reduction: number): T {
  if (reduction <= 0) return asked;
  const upTo = (from: number, length: number): number => Math.max(0, Math.min(1, (reduction - from) / length));
  const { supersampling, views, leastGain, layers, bias } = asked;
  const samples = Math.round(supersampling ** (1 - upTo(0, 1)));
  return {
    ...asked,
    // Frames smaller than the picture shrink in eighths of it: each size is an allocation.
    supersampling: reduction > 4 ? 1 - Math.round(4 * upTo(4, 1)) / 8 : samples,
    leastGain: leastGain * LESS_GAIN ** upTo(1, 1),
    views: views === null || reduction < 1.5 ? views : Math.min(views, FEWER_VIEWS),
    layers: reduction < 2 ? layers : 1,
    bias: bias + MORE_BIAS * upTo(2, 2),
  };
}
