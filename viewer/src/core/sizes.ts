import type { Resource, ResourceKind } from "./resource.js";

/** Bytes on the wire and decoded, of what has been seen of a kind. */
interface Seen {
  wire: number;
  decoded: number;
}

/** What values take once they are decoded: as much as they took before, or as others of their kind take. */
export class Sizes {
  /** Begins with a guess of how much a byte on the wire becomes: 13 measured of tiles; leaves with textures 8 and more. */
  private readonly seen: Record<ResourceKind, Seen> = {
    orthoview: { wire: 1, decoded: 13 },
    geometry: { wire: 1, decoded: 8 },
    mesh: { wire: 1, decoded: 2 },
  };

  /** A value was decoded, and its size is known. */
  learn({ kind, bytes, size }: Resource): void {
    this.seen[kind].wire += bytes;
    this.seen[kind].decoded += size;
  }

  of({ kind, bytes, size }: Resource): number {
    return size || (bytes * this.seen[kind].decoded) / this.seen[kind].wire;
  }
}
