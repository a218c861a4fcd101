import type { Backoff } from "./backoff.js";
import { asFarfieldError, FarfieldError } from "./errors.js";
import type { Manifest } from "./manifest.js";
import type { Resource } from "./resource.js";
import { serverOf } from "./serverrule.js";
import type { Found, Source } from "./source.js";

/** One failure may be chance: a server is taken to be away from the second in a row on. */
const AWAY_FAILURES = 2;

/**
 * A web server with values of a world. After a failure it is not asked for any before it has answered a knock; knocks
 * come after longer and longer pauses, one at a time, so that nobody fills the console of the browser.
 */
export class Server {
  private knocking = false;
  /** Fulfilled when the first knock has been answered, or has not. */
  private readonly met: Promise<void>;

  /** known: it has answered before. back: called when it answers again. */
  constructor(
    readonly source: Source,
    readonly backoff: Backoff,
    private readonly signal: AbortSignal,
    private readonly back: () => void,
    known: boolean,
  ) {
    this.met = known ? Promise.resolve() : new Promise((resolve) => void this.knock(resolve));
  }

  /** Whether it may be asked for values. */
  get reachable(): boolean {
    return !this.knocking;
  }

  /** Whether it has not answered for a while. */
  get away(): boolean {
    return this.knocking && this.backoff.failures >= AWAY_FAILURES;
  }

  /** As `Source.get`; rejects with `network` at once while the server does not answer. */
  async get(key: string, signal: AbortSignal, fresh = false): Promise<Uint8Array> {
    await this.met;
    if (this.knocking) throw new FarfieldError("network", "the server does not answer", key);
    return this.watch(this.source.get(key, signal, fresh), key);
  }

  /** As `Source.getMany`. */
  getMany(keys: readonly string[], signal: AbortSignal): Promise<Found[]> {
    return this.watch(this.source.getMany(keys, signal), keys[0]!);
  }

  /** Notes that an attempt has failed, whatever for. */
  failed(what: string): void {
    this.backoff.failed(what);
    if (!this.knocking) void this.knock();
  }

  private async watch<T>(answer: Promise<T>, key: string): Promise<T> {
    try {
      const found = await answer;
      this.backoff.succeeded();
      return found;
    } catch (thrown) {
      const error = asFarfieldError(thrown, key);
      if (error.tag === "network") this.failed(error.what);
      throw error;
    }
  }

  private async knock(met: () => void = () => undefined): Promise<void> {
    this.knocking = true;
    do {
      await this.backoff.rest();
      if (!this.signal.aborted) this.knocking = !(await this.answers());
      met();
    } while (this.knocking && !this.signal.aborted);
    // Also when it is given up: then nobody misses it any more.
    this.backoff.reached();
    this.back();
  }

  private async answers(): Promise<boolean> {
    try {
      await this.source.knock(this.signal);
      return true;
    } catch (thrown) {
      this.backoff.failed(asFarfieldError(thrown, this.source.base).what);
      return false;
    }
  }
}

/** What makes the server at an address, to be closed by the signal. */
export type ServerMaker = (address: string, signal: AbortSignal) => Server;

/** The servers of a world: the one it was opened at, and those over which it is split. */
export class Servers {
  /** Each once; the first is the one that the manifest came from. */
  readonly all: readonly Server[];
  private readonly parts: readonly Server[];
  private readonly closing = new AbortController();

  constructor(
    home: Server,
    private readonly manifest: Pick<Manifest, "servers" | "grid">,
    make: ServerMaker,
  ) {
    const known = new Map([[home.source.base, home]]);
    this.parts = (manifest.servers?.addresses ?? []).map((address) => {
      const base = new URL(address, home.source.base).href;
      const server = known.get(base) ?? make(base, this.closing.signal);
      known.set(base, server);
      return server;
    });
    this.all = [...known.values()];
  }

  /** Bytes and requests since the start. */
  get bytes(): number {
    return this.all.reduce((sum, { source }) => sum + source.bytes, 0);
  }

  get requests(): number {
    return this.all.reduce((sum, { source }) => sum + source.requests, 0);
  }

  /** The server that has a key. */
  of(key: string): Server {
    const { servers, grid } = this.manifest;
    const number = servers ? serverOf(key, servers, grid) : null;
    return number === null ? this.all[0]! : this.parts[number]!;
  }

  /** Whether a key's server is away while others are there: then the world is to be shown without it. */
  isAway(key: string): boolean {
    return this.of(key).away && !this.all.every(({ away }) => away);
  }

  /** What tells, as things stand, whether a value cannot be had: it is bad, or it or what it needs is where nobody answers. */
  lacking(): (resource: Resource) => boolean {
    const away = new Set(this.all.filter((server) => server.away));
    if (away.size === 0 || away.size === this.all.length) return ({ state }) => state === "bad";
    const isAway = (key: string | null): boolean => key !== null && away.has(this.of(key));
    return ({ key, state, needs }) => state === "bad" || ((state === "absent" || state === "loading") && (isAway(key) || isAway(needs)));
  }

  /** Whether a value, and everything that it is known to need, may be asked for now. */
  mayAsk({ needs, isPushed }: Resource): boolean {
    return !isPushed && (needs === null || this.of(needs).reachable);
  }

  /** Gives up all but the first, whose end is up to its maker. */
  close(): void {
    this.closing.abort();
  }
}
