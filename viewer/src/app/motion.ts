import type { WorldOptions } from "../three/options.js";

/** A frame that takes longer than this is drawn with fewer samples while the camera moves. */
const SLOW_MS = 50;
const REST_MS = 250;

/** Chooses fewer samples while a slow card is in motion, and the full number once it rests. */
export class MotionQuality {
  private lastMove = -Infinity;
  private slow = false;

  constructor(
    /** Samples a side that the person asked for. */
    public wanted: number,
    private readonly apply: (changes: Pick<WorldOptions, "supersampling">) => void,
    private applied = wanted,
  ) {}

  /** To be called each frame with whether a person moved the camera and how long the last frame took. */
  step(now: number, moved: boolean, frameMs: number): void {
    if (moved) this.lastMove = now;
    const moving = now - this.lastMove < REST_MS;
    if (!moving) this.slow = false;
    else if (frameMs > SLOW_MS) this.slow = true;
    const samples = moving && this.slow ? 1 : this.wanted;
    if (samples === this.applied) return;
    this.applied = samples;
    this.apply({ supersampling: samples });
  }
}
