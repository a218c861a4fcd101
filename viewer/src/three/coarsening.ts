import type { Resource } from "../core/resource.js";

const STEP = 0.5;
const COARSEST = 6;
/** Decoded bytes a byte on the wire, until tiles have been seen. */
const FIRST_GUESS = 8;

/** Makes the cut coarser while what it wants would not fit into the budget, and finer again when it would. */
export class CoarseningControl {
  /** Levels by which the cut is coarser than asked. */
  levels = 0;
  private ratio = FIRST_GUESS;

  /** Looks at what a picture wants; returns whether `levels` has changed. */
  adapt(wanted: readonly Resource[], budget: number): boolean {
    let [wire, decoded, bytes] = [0, 0, 0];
    for (const { state, size, bytes: onWire } of wanted) {
      if (state !== "held" && state !== "ready") continue;
      decoded += size;
      wire += onWire;
    }
    if (wire > 0) this.ratio = decoded / wire;
    for (const { state, size, bytes: onWire } of wanted) {
      bytes += state === "held" || state === "ready" ? size : state === "bad" ? 0 : onWire * this.ratio;
    }
    const before = this.levels;
    if (bytes > budget) this.levels = Math.min(COARSEST, this.levels + STEP);
    // Half a level finer is at most about twice the bytes; the rest keeps it from swinging.
    else if (bytes < budget * 0.35) this.levels = Math.max(0, this.levels - STEP);
    return this.levels !== before;
  }
}
