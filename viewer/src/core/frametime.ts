import { MOST_REDUCTION, REDUCTION_STEP } from "./reduction.js";

/** A picture rests when nothing has moved for so long. */
export const REST_MS = 250;
/** Frames slower than this many times the target make the next ones less, frames faster than that make them more again. */
const SLOW = 1.15;
const FAST = 0.7;
/** Share of the way to go at once, and the farthest. */
const DOWN = 0.7;
const FARTHEST = 3;
/** Fast frames in a row after which a step more is tried; for a step that was too much, twice as many each time. */
const PATIENCE = 6;
const MOST_PATIENCE = 192;
/** Frames after a step more in which a slow one is its fault. */
const TRIAL = 8;
/** What frames at rest say about those in motion is not certain: they may have been slow because things came in. */
const DOUBT = 0.75;

/** Keeps the frames of a moving picture near a time by drawing less, as much less as they show to be needed. */
export class FrameTimeControl {
  /** What frames in motion are drawn with, 0 to MOST_REDUCTION. */
  private level = 0;
  private lastMove = -Infinity;
  private fast = 0;
  /** The level that was tried last and was too much, and how patient to be before it is tried again. */
  private tooMuch = -1;
  private patience = PATIENCE;
  private sinceMore = Infinity;

  /** targetMs: what a frame may take; 0: whatever it takes. */
  constructor(public targetMs: number) {}

  /** Something moves. */
  moved(now: number): void {
    this.lastMove = now;
  }

  /** Everything is wanted: what has moved counts as at rest, until it moves again. */
  rests(): void {
    this.lastMove = -Infinity;
  }

  /** Whether frames are of a moving picture. */
  moving(now: number): boolean {
    return this.targetMs > 0 && now - this.lastMove < REST_MS;
  }

  /** How much less is to be drawn now: nothing at rest. */
  reduction(now: number): number {
    return this.moving(now) ? this.level : 0;
  }

  /** Takes how long a frame took, and the reduction that it was drawn with. */
  measured(milliseconds: number, reduction: number): void {
    if (this.targetMs <= 0) return;
    const needed = Math.log2(milliseconds / this.targetMs);
    if (reduction !== this.level) this.foresee(needed, reduction);
    else if (milliseconds > SLOW * this.targetMs) this.drawLess(needed);
    else if (milliseconds < FAST * this.targetMs) this.drawMore();
    else this.fast = 0;
    if (this.sinceMore++ === TRIAL && this.level <= this.tooMuch) [this.tooMuch, this.patience] = [-1, PATIENCE];
  }

  private drawLess(needed: number): void {
    if (this.sinceMore < TRIAL) [this.tooMuch, this.patience] = [this.level, Math.min(MOST_PATIENCE, 2 * this.patience)];
    this.fast = 0;
    this.sinceMore = Infinity;
    this.set(this.level + Math.max(REDUCTION_STEP, Math.min(FARTHEST, DOWN * needed)));
  }

  private drawMore(): void {
    const next = this.level - REDUCTION_STEP;
    if (next < 0 || ++this.fast < (next <= this.tooMuch ? this.patience : PATIENCE)) return;
    this.fast = this.sinceMore = 0;
    this.set(next);
  }

  /** A frame with all that is asked for, at rest, tells how much less the first one in motion should be. */
  private foresee(needed: number, reduction: number): void {
    if (reduction === 0) this.set(Math.max(this.level, DOUBT * needed));
  }

  private set(level: number): void {
    this.level = Math.max(0, Math.min(MOST_REDUCTION, Math.round(level / REDUCTION_STEP) * REDUCTION_STEP));
  }
}
