import type { WorldOptions } from "../three/options.js";

/** A frame that takes longer than this is too slow to move by. */
const SLOW_MS = 60;
const REST_MS = 250;

/** What a person asked for, and what is less of it. */
export type Quality = Pick<WorldOptions, "supersampling" | "leastGain" | "layers">;

/** From full quality to the least; each step needs nothing that the one before did not fetch. */
const STEPS: readonly ((wanted: Quality) => Quality)[] = [
  (wanted) => wanted,
  (wanted) => ({ ...wanted, supersampling: 1 }),
  ({ leastGain }) => ({ supersampling: 1, leastGain: 4 * leastGain, layers: 1 }),
];

/** Draws less while a slow card is in motion, and everything once it rests. */
export class MotionQuality {
  private lastMove = -Infinity;
  private lastFrame = -1;
  private step = 0;

  constructor(
    public wanted: Quality,
    private readonly apply: (quality: Quality) => void,
  ) {}

  /** Whether less is drawn than asked for. */
  get reduced(): boolean {
    return this.step > 0;
  }

  /** To be called each frame: whether a person moved the camera, which frame was measured last and how long it took. */
  advance(now: number, moved: boolean, frame: number, frameMs: number): void {
    if (moved) this.lastMove = now;
    let next = this.step;
    if (now - this.lastMove >= REST_MS) next = 0;
    else if (frame !== this.lastFrame && frameMs > SLOW_MS) next = Math.min(STEPS.length - 1, this.step + 1);
    this.lastFrame = frame;
    if (next === this.step) return;
    this.step = next;
    this.apply(STEPS[next]!(this.wanted));
  }
}
