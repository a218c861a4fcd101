import type { Cell } from "./cell.js";

const NO_IMAGES: ReadonlyMap<string, number> = new Map();

/** What a value of the store is drawn as. */
export type ResourceKind = "orthoview" | "blockmap" | "geometry" | "mesh" | "impostor";

/**
 *     absent → loading ─────────────→ ready → held
 *        ↑        ├──→ fetched ─→ loading ┘
 *        │        └──→ bad
 *        └─── dropped by the cache or the stock, or aborted
 *
 * `fetched` came ahead of its time and waits to be decoded; `ready` is decoded and waits for its turn to be uploaded.
 */
export type ResourceState = "absent" | "loading" | "fetched" | "ready" | "held" | "bad";

/** A value of the store that can be drawn, and how far it has come. */
export class Resource {
  state: ResourceState = "absent";
  /** What the drawing side made of it, while held. */
  payload: unknown = null;
  /** Bytes it takes while ready or held; stays when it is dropped, 0 until it was decoded for the first time. */
  size = 0;
  /** Number of the last plan that had a use for it. */
  used = 0;
  /** Key of another value without which it cannot be prepared, and which could not be had at the last attempt. */
  needs: string | null = null;
  /** The newest generation does not have it. */
  gone = false;
  /** Hash and bytes of each image that it needs; of a mesh, as far as a leaf that lists its instances tells. */
  images = NO_IMAGES;

  constructor(
    readonly key: string,
    readonly kind: ResourceKind,
    /** Bytes on the wire. */
    readonly bytes: number,
    /** The cell it belongs to; null for meshes and their images from round about, which several share. */
    public cell: Cell | null,
    /** Whether a server sends it by itself or not at all: nobody can ask for it. */
    readonly isPushed = false,
  ) {}

  get held(): boolean {
    return this.state === "held";
  }

  /** Whether it is on its way, or has come and cannot be drawn yet. */
  get coming(): boolean {
    return this.state === "loading" || this.state === "fetched" || this.state === "ready";
  }

  /** Belongs from now on to the cell of a newer generation, which finds it there again; what was bad is tried once more. */
  moveTo(cell: Cell): void {
    this.cell = cell;
    this.gone = false;
    if (this.state === "bad") this.state = "absent";
    if (this.held) cell.count(1);
  }
}
