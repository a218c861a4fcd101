import { asFarfieldError, type FarfieldError } from "../core/errors.js";
import { Follower } from "../core/follower.js";
import type { Manifest } from "../core/manifest.js";
import type { Server } from "../core/servers.js";
import { openManifest } from "./opening.js";

/** A world of many bad tiles is not asked for its manifest with each of them. */
const LEAST_MS = 5000;

export interface GenerationParts {
  /** Where the manifest is. */
  readonly home: Server;
  readonly signal: AbortSignal;
  /** The newest manifest that is known. */
  readonly newest: () => Manifest | null;
  /** There is another, which is to be shown. */
  readonly found: (manifest: Manifest) => void;
  /** The manifest is no longer one. */
  readonly unreadable: (error: FarfieldError) => void;
}

/** Finds new generations of a world: when the server tells of one, or when something is missing. */
export class Generations {
  private readonly follower: Follower | null;
  private looking: Promise<boolean> | null = null;
  private lookedAt = -Infinity;

  /** Begins to listen, where the server tells; the manifest has been read. */
  constructor(private readonly parts: GenerationParts) {
    const { events } = parts.home.source;
    this.follower = events && "EventSource" in globalThis ? new Follower(events, (tag) => void this.heard(tag)) : null;
  }

  /** Whether the manifest is being read again. */
  get busy(): boolean {
    return this.looking !== null;
  }

  /** Reads the manifest again; gives whether it is another. A world baked from nothing begins with generation 1 again. */
  look(): Promise<boolean> {
    this.looking ??= this.read().finally(() => (this.looking = null));
    return this.looking;
  }

  /** Whether a value that is missing belongs to a generation that has been replaced. */
  async explains(): Promise<boolean> {
    // Another server may miss it while the one that could tell is away.
    if (!this.parts.home.reachable) return false;
    if (!this.looking && performance.now() < this.lookedAt + LEAST_MS) return false;
    return this.look();
  }

  close(): void {
    this.follower?.close();
  }

  private async heard(tag: string): Promise<void> {
    // A reading that is under way may have begun before.
    await this.looking;
    if (tag !== this.parts.home.source.tag) await this.look();
  }

  /** A manifest that cannot be read leaves the picture as it is. */
  private async read(): Promise<boolean> {
    const { home, signal, newest, found, unreadable } = this.parts;
    const { source, backoff } = home;
    try {
      const manifest = await openManifest(source, backoff, signal);
      this.lookedAt = performance.now();
      if (signal.aborted || manifest.text === newest()?.text) return false;
      found(manifest);
      return true;
    } catch (thrown) {
      const error = asFarfieldError(thrown, source.base);
      this.lookedAt = performance.now();
      if (error.tag !== "aborted") unreadable(error);
      return false;
    }
  }
}
