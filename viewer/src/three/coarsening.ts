import type { Resource } from "../core/resource.js";
import { SURE, type Sizes } from "../core/sizes.js";

const STEP = 0.5;
const COARSEST = 6;

/** Makes the cut coarser while what it wants would not fit into the budget, and finer again when it would. */
export class CoarseningControl {
  /** Levels by which the cut is coarser than asked. */
  levels = 0;

  constructor(private readonly sizes: Sizes) {}

  /** Looks at what a picture wants; returns whether it should be coarser than it is, or may be finer. */
  adapt(wanted: readonly Resource[], budget: number): "coarser" | "finer" | "same" {
    let bytes = 0;
    for (const resource of wanted) if (resource.state !== "bad") bytes += this.sizes.of(resource);
    const before = this.levels;
    if (bytes > budget * SURE) this.levels = Math.min(COARSEST, this.levels + STEP);
    // Half a level finer is at most about twice the bytes; the rest keeps it from swinging.
    else if (bytes < budget * 0.35) this.levels = Math.max(0, this.levels - STEP);
    return this.levels > before ? "coarser" : this.levels < before ? "finer" : "same";
  }
}
