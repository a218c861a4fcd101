import type { Backoff } from "./backoff.js";
import { Cache } from "./cache.js";
import { asFarfieldError, type FarfieldError } from "./errors.js";
import type { Resource } from "./resource.js";
import { valueOf, type Found, type Source } from "./source.js";
import { URGENCY, type Want } from "./wants.js";

/** A decoded value that waits to be uploaded. */
export interface Prepared {
  /** Bytes it takes. */
  readonly size: number;
  /** Uploads it; what it returns becomes the resource's payload. */
  install(): unknown;
  /** Drops it without uploading. */
  discard?(): void;
}

/** How the drawing side turns bytes into something drawn. */
export interface Preparer {
  prepare(resource: Resource, bytes: Uint8Array, signal: AbortSignal): Promise<Prepared>;
  dispose(resource: Resource, payload: unknown): void;
}

export interface LoaderEvents {
  readonly bad: (resource: Resource, error: FarfieldError) => void;
  /** Something came in: it is time for another frame. */
  readonly arrived: () => void;
}

const REQUESTS = 6;
const REQUEST_BYTES = 256 << 10;
/** Values under way and decoded but not uploaded; more would only grow old. */
const UNDER_WAY = 128;

/** Fetches what is wanted, most urgent first, decodes it, and keeps it within a budget of bytes. */
export class Loader {
  readonly cache: Cache;
  private wants: readonly Want[] = [];
  private plan = 0;
  private readonly requests = new Map<AbortController, Resource[]>();
  private readonly loading = new Map<Resource, AbortController>();
  private readonly ready = new Map<Resource, Prepared>();
  private readonly damaged = new Set<Resource>();
  private timer: ReturnType<typeof setTimeout> | undefined;

  constructor(
    private readonly source: Source,
    private readonly backoff: Backoff,
    private readonly preparer: Preparer,
    budget: number,
    private readonly events: LoaderEvents,
  ) {
    this.cache = new Cache(budget, (resource) => this.drop(resource));
  }

  /** Values asked for and not yet held. */
  get underWay(): number {
    return this.loading.size + this.ready.size;
  }

  /** Takes the wants of plan `number`, most urgent first; gives up requests that none of them needs. */
  want(wants: readonly Want[], number: number): void {
    this.wants = wants;
    this.plan = number;
    for (const { resource, urgency } of wants) {
      if (urgency <= URGENCY.seen) this.cache.use(resource, number);
    }
    const wanted = new Set(wants.map(({ resource }) => resource));
    for (const [controller, resources] of this.requests) {
      if (!resources.some((resource) => wanted.has(resource))) controller.abort();
    }
    this.pump();
  }

  /** Uploads what is decoded, most urgent first, until `bytes` have been; returns whether anything was. */
  install(bytes: number): boolean {
    if (this.ready.size === 0) return false;
    let left = bytes;
    const order = this.wants.map(({ resource }) => resource).filter((resource) => this.ready.has(resource));
    for (const resource of new Set([...order, ...this.ready.keys()])) {
      if (left <= 0) break;
      left -= resource.size;
      this.hold(resource);
    }
    this.pump();
    return true;
  }

  /** Marks what a plan draws, then drops what no longer fits. */
  keep(drawn: Iterable<Resource>, number: number): void {
    for (const resource of drawn) this.cache.use(resource, number);
    this.cache.trim(number);
  }

  /** Gives everything up. */
  clear(): void {
    clearTimeout(this.timer);
    for (const controller of this.requests.keys()) controller.abort();
    this.wants = [];
    this.cache.clear();
  }

  /** Starts as many requests as there is room for. */
  pump(): void {
    clearTimeout(this.timer);
    const wait = this.backoff.wait;
    if (wait > 0) {
      this.timer = setTimeout(() => this.pump(), wait);
      return;
    }
    for (let next = 0; this.requests.size < REQUESTS && this.underWay < UNDER_WAY; ) {
      const chosen: Resource[] = [];
      let bytes = 0;
      for (; next < this.wants.length && chosen.length < this.source.batchKeys && bytes < REQUEST_BYTES; next++) {
        const { resource, urgency } = this.wants[next]!;
        if (resource.state !== "absent" || !this.fits(resource, urgency)) continue;
        chosen.push(resource);
        bytes += resource.bytes;
      }
      if (chosen.length === 0) return;
      void this.request(chosen);
    }
  }

  /** What is not needed for the picture comes only while there is room. */
  private fits(resource: Resource, urgency: number): boolean {
    return urgency <= URGENCY.seen || this.cache.bytes + resource.bytes * 8 < this.cache.budget * 0.7;
  }

  private async request(resources: Resource[]): Promise<void> {
    const controller = new AbortController();
    this.requests.set(controller, resources);
    for (const resource of resources) {
      resource.state = "loading";
      this.loading.set(resource, controller);
    }
    try {
      const answers = await this.source.getMany(resources.map(({ key }) => key), controller.signal);
      this.backoff.succeeded();
      resources.forEach((resource, n) => void this.prepare(resource, answers[n]!, controller.signal));
    } catch (error) {
      const known = asFarfieldError(error, resources[0]!.key);
      for (const resource of resources) this.release(resource);
      if (known.tag === "missing") for (const resource of resources) this.fail(resource, known);
      else if (known.tag !== "aborted") this.backoff.failed(known.what);
    } finally {
      this.requests.delete(controller);
      this.pump();
    }
  }

  private async prepare(resource: Resource, found: Found, signal: AbortSignal): Promise<void> {
    try {
      const prepared = await this.preparer.prepare(resource, valueOf(found, resource.key), signal);
      this.loading.delete(resource);
      resource.state = "ready";
      resource.size = prepared.size;
      this.ready.set(resource, prepared);
      this.cache.trim(this.plan, prepared.size);
      this.cache.add(resource);
      this.events.arrived();
    } catch (error) {
      this.release(resource);
      const known = asFarfieldError(error, resource.key);
      if (known.tag === "aborted") return;
      if (known.tag === "network") this.backoff.failed(known.what);
      else if (known.tag === "corrupt" && !this.damaged.has(resource)) void this.requestAnew(resource);
      else this.fail(resource, known);
    }
    this.pump();
  }

  /** A damaged value may have been damaged on the way: it is asked for once more, past all caches. */
  private async requestAnew(resource: Resource): Promise<void> {
    this.damaged.add(resource);
    const controller = new AbortController();
    this.requests.set(controller, [resource]);
    this.loading.set(resource, controller);
    resource.state = "loading";
    try {
      const bytes = await this.source.get(resource.key, controller.signal, true);
      await this.prepare(resource, bytes, controller.signal);
    } catch (error) {
      this.release(resource);
      const known = asFarfieldError(error, resource.key);
      if (known.tag === "missing") this.fail(resource, known);
    } finally {
      this.requests.delete(controller);
    }
  }

  private hold(resource: Resource): void {
    const prepared = this.ready.get(resource)!;
    this.ready.delete(resource);
    resource.payload = prepared.install();
    resource.state = "held";
    resource.cell?.count(1);
  }

  private fail(resource: Resource, error: FarfieldError): void {
    resource.state = "bad";
    this.events.bad(resource, error);
  }

  private release(resource: Resource): void {
    this.loading.delete(resource);
    if (resource.state === "loading") resource.state = "absent";
  }

  private drop(resource: Resource): void {
    if (resource.state === "held") {
      resource.cell?.count(-1);
      this.preparer.dispose(resource, resource.payload);
    } else {
      this.ready.get(resource)?.discard?.();
      this.ready.delete(resource);
    }
    resource.payload = null;
    resource.state = "absent";
  }
}
