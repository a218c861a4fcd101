import type { Backoff } from "./backoff.js";
import { Cell, SharedMeshes } from "./cell.js";
import { asFarfieldError, FarfieldError } from "./errors.js";
import type { Fetcher } from "./fetch.js";
import { decodeIndexTile } from "./indextile.js";
import { indexKey } from "./keys.js";
import { decodeManifest, type Manifest } from "./manifest.js";

export interface WorldEvents {
  readonly bad: (key: string, error: FarfieldError) => void;
  /** More of the index is known. */
  readonly grown: () => void;
}

/** A world as far as its index has been read. */
export class WorldIndex {
  readonly roots: readonly Cell[];
  private readonly shared = new SharedMeshes();
  private readonly loading = new Set<Cell>();
  private readonly closing = new AbortController();

  private constructor(
    readonly manifest: Manifest,
    private readonly fetcher: Fetcher,
    private readonly backoff: Backoff,
    private readonly events: WorldEvents,
  ) {
    this.roots = manifest.roots.map(({ key, hash }) => {
      const root = new Cell(key, null, manifest.grid);
      root.indexHash = hash;
      return root;
    });
  }

  /** Reads the manifest. Rejects with `network`, `missing`, `not-a-world`, `version` or `aborted`. */
  static async open(fetcher: Fetcher, backoff: Backoff, events: WorldEvents, signal: AbortSignal): Promise<WorldIndex> {
    const text = await fetcher.manifest(signal);
    return new WorldIndex(decodeManifest(text, `${fetcher.base}world.json`), fetcher, backoff, events);
  }

  /** Number of index tiles under way. */
  get pending(): number {
    return this.loading.size;
  }

  /** Starts reading the index below cells; those that are being read already are left alone. */
  explore(cells: readonly Cell[]): void {
    for (const cell of cells) {
      if (cell.indexHash && !this.loading.has(cell)) void this.load(cell);
    }
  }

  close(): void {
    this.closing.abort();
  }

  private async load(cell: Cell): Promise<void> {
    this.loading.add(cell);
    const key = indexKey(cell.name, cell.indexHash);
    try {
      const bytes = await this.fetcher.get(key, this.closing.signal);
      this.backoff.succeeded();
      const entries = await decodeIndexTile(bytes, key);
      cell.read(new Map(entries.map((entry) => [entry.key, entry])), this.shared, key);
    } catch (thrown) {
      await this.failed(cell, key, asFarfieldError(thrown, key));
    } finally {
      this.loading.delete(cell);
      if (!this.closing.signal.aborted) this.events.grown();
    }
  }

  /** A lost connection is waited for; a cell whose index is damaged ends there and stays a picture. */
  private async failed(cell: Cell, key: string, error: FarfieldError): Promise<void> {
    if (error.tag === "aborted") return;
    if (error.tag === "network") {
      this.backoff.failed(error.what);
      await this.backoff.rest();
      return;
    }
    cell.indexHash = "";
    cell.children = [];
    this.events.bad(key, error);
  }
}
