import type { Resource, ResourceKind } from "../core/resource.js";

const STEP = 0.5;
const COARSEST = 6;

/** Bytes on the wire and decoded, of what has been seen of a kind. */
interface Seen {
  wire: number;
  decoded: number;
}

/** Makes the cut coarser while what it wants would not fit into the budget, and finer again when it would. */
export class CoarseningControl {
  /** Levels by which the cut is coarser than asked. */
  levels = 0;
  /** Begins with a guess of how much a byte on the wire becomes. */
  private readonly seen: Record<ResourceKind, Seen> = {
    orthoview: { wire: 1, decoded: 8 },
    geometry: { wire: 1, decoded: 2 },
    mesh: { wire: 1, decoded: 2 },
  };
  private readonly counted = new WeakSet<Resource>();

  /** Looks at what a picture wants; returns whether it should be coarser than it is, or may be finer. */
  adapt(wanted: readonly Resource[], budget: number): "coarser" | "finer" | "same" {
    const bytes = this.estimate(wanted);
    const before = this.levels;
    if (bytes > budget) this.levels = Math.min(COARSEST, this.levels + STEP);
    // Half a level finer is at most about twice the bytes; the rest keeps it from swinging.
    else if (bytes < budget * 0.35) this.levels = Math.max(0, this.levels - STEP);
    return this.levels > before ? "coarser" : this.levels < before ? "finer" : "same";
  }

  private estimate(wanted: readonly Resource[]): number {
    let bytes = 0;
    for (const resource of wanted) {
      const { state, size, kind } = resource;
      const known = state === "held" || state === "ready";
      if (known && !this.counted.has(resource)) {
        this.counted.add(resource);
        this.seen[kind].wire += resource.bytes;
        this.seen[kind].decoded += size;
      }
      if (known) bytes += size;
      else if (state !== "bad") bytes += (resource.bytes * this.seen[kind].decoded) / this.seen[kind].wire;
    }
    return bytes;
  }
}
