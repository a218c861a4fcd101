import { Cache } from "./cache.js";
import { asFarfieldError, type FarfieldError } from "./errors.js";
import type { Resource } from "./resource.js";
import type { Server, Servers } from "./servers.js";
import { Sizes, SURE } from "./sizes.js";
import { valueOf, type Found } from "./source.js";
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

/** To one server at once: as many as browsers open connections to it. */
const REQUESTS = 6;
/** To all of them, as far as each has two: more would only share the same line. */
const REQUESTS_TO_ALL = 24;
const REQUEST_BYTES = 256 << 10;
/** Values under way and decoded but not uploaded, of all servers together; more would only grow old. */
const UNDER_WAY = 128;

/** What is under way from one server. */
interface Request {
  readonly server: Server;
  readonly resources: readonly Resource[];
}

/** Fetches what is wanted, most urgent first, decodes it, and keeps it within a budget of bytes. */
export class Loader {
  readonly cache: Cache;
  readonly sizes = new Sizes();
  private wants: readonly Want[] = [];
  /** The same by server. */
  private queues: ReadonlyMap<Server, readonly Want[]> = new Map();
  private plan = 0;
  /** Whether what is in the picture may go beyond the budget. */
  private beyond = false;
  /** Bytes of what is under way, as far as can be told. */
  private coming = 0;
  /** Bytes of what the plan uses, there or under way. */
  private taken = 0;
  private readonly requests = new Map<AbortController, Request>();
  private readonly loading = new Map<Resource, AbortController>();
  private readonly ready = new Map<Resource, Prepared>();
  private readonly damaged = new Set<Resource>();
  private readonly homes = new WeakMap<Resource, Server>();

  constructor(
    private readonly servers: Servers,
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

  /**
   * Takes the wants of plan `number`, most urgent first, and what it draws meanwhile; gives up requests that none of them
   * needs, and drops what no longer fits. `beyond`: what is in the picture need not fit beside what it is to replace.
   */
  want(wants: readonly Want[], number: number, drawn: Iterable<Resource> = [], beyond = false): void {
    this.beyond = beyond;
    this.wants = wants;
    this.queues = grouped(wants, ({ resource }) => this.serverOf(resource));
    this.plan = number;
    for (const { resource, urgency } of wants) {
      if (urgency <= URGENCY.seen) this.cache.use(resource, number);
    }
    for (const resource of drawn) this.cache.use(resource, number);
    this.cache.trim(number);
    const wanted = new Set(wants.map(({ resource }) => resource));
    for (const [controller, { resources }] of this.requests) {
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

  /** Gives everything up. */
  clear(): void {
    for (const controller of this.requests.keys()) controller.abort();
    this.wants = [];
    this.queues = new Map();
    this.cache.clear();
  }

  /** Starts as many requests as there is room for. A server that is slow leaves room for the others. */
  pump(): void {
    const { length } = this.servers.all;
    const most = Math.min(REQUESTS, Math.max(2, Math.floor(REQUESTS_TO_ALL / length)));
    this.taken = this.cache.inUse(this.plan);
    this.coming = 0;
    for (const resource of this.loading.keys()) this.expect(resource);
    for (const [server, wants] of this.queues) this.ask(server, wants, most, UNDER_WAY / length);
  }

  /** Starts requests to one server: at most so many at once, for at most so many values. */
  private ask(server: Server, wants: readonly Want[], requests: number, values: number): void {
    const asked = [...this.requests.values()].filter((request) => request.server === server);
    let free = requests - asked.length;
    // What does not fit still comes, one at a time: it may be that all that stands in its way waits for it.
    let alone = this.ready.size === 0 && ![...this.loading.keys()].some((resource) => this.serverOf(resource) === server);
    let left = values - asked.reduce((sum, { resources }) => sum + resources.length, 0);
    for (let next = 0; server.reachable && free > 0 && left > 0 && this.underWay < UNDER_WAY; free--) {
      const chosen: Resource[] = [];
      let bytes = 0;
      const most = Math.min(server.source.batchKeys, left);
      for (; next < wants.length && chosen.length < most && bytes < REQUEST_BYTES; next++) {
        const { resource, urgency } = wants[next]!;
        if (resource.state !== "absent" || !this.servers.mayAsk(resource)) continue;
        if (!this.fits(resource, urgency, alone && chosen.length === 0)) {
          // What is more urgent is not to wait until smaller things of this server have filled the room.
          if (urgency <= URGENCY.seen) break;
          continue;
        }
        chosen.push(resource);
        bytes += resource.bytes;
        this.expect(resource);
      }
      if (chosen.length === 0) return;
      left -= chosen.length;
      alone = false;
      void this.request(server, chosen);
    }
  }

  private serverOf(resource: Resource): Server {
    const server = this.homes.get(resource) ?? this.servers.of(resource.key);
    this.homes.set(resource, server);
    return server;
  }

  private expect(resource: Resource): void {
    const size = this.sizes.of(resource);
    this.coming += size;
    if (resource.used >= this.plan) this.taken += size;
  }

  /**
   * What is needed for the picture waits until it fits beside what stands in for it, unless it is alone under way from its
   * server; what is not needed comes only while there is room.
   */
  private fits(resource: Resource, urgency: number, alone: boolean): boolean {
    const size = this.sizes.of(resource);
    if (urgency > URGENCY.seen) return this.cache.bytes + this.coming + size < this.cache.budget * 0.7;
    return this.taken + size <= this.cache.budget * SURE || alone || this.beyond;
  }

  private async request(server: Server, resources: Resource[]): Promise<void> {
    const controller = new AbortController();
    this.requests.set(controller, { server, resources });
    for (const resource of resources) {
      resource.state = "loading";
      this.loading.set(resource, controller);
    }
    try {
      const answers = await server.getMany(resources.map(({ key }) => key), controller.signal);
      resources.forEach((resource, n) => void this.prepare(resource, answers[n]!, controller.signal));
    } catch (error) {
      const known = asFarfieldError(error, resources[0]!.key);
      for (const resource of resources) this.release(resource);
      if (known.tag === "missing") for (const resource of resources) this.fail(resource, known);
      else if (known.tag !== "aborted") server.failed(known.what);
    } finally {
      this.requests.delete(controller);
      this.pump();
    }
  }

  private async prepare(resource: Resource, found: Found, signal: AbortSignal): Promise<void> {
    try {
      const prepared = await this.preparer.prepare(resource, valueOf(found, resource.key), signal);
      this.loading.delete(resource);
      resource.needs = null;
      resource.state = "ready";
      const isNew = resource.size === 0;
      resource.size = prepared.size;
      if (isNew) this.sizes.learn(resource);
      this.ready.set(resource, prepared);
      this.cache.trim(this.plan, prepared.size);
      this.cache.add(resource);
      this.events.arrived();
    } catch (error) {
      this.release(resource);
      const known = asFarfieldError(error, resource.key);
      if (known.tag === "aborted") return;
      if (known.tag === "network") this.postpone(resource, known);
      else if (known.tag === "corrupt" && !this.damaged.has(resource)) void this.requestAnew(resource);
      else this.fail(resource, known);
    }
    this.pump();
  }

  /** Leaves a value until the server answers that it, or what it refers to, is to come from. */
  private postpone(resource: Resource, { what, where }: FarfieldError): void {
    resource.needs = where === resource.key ? null : where;
    if (resource.needs === null) this.serverOf(resource).failed(what);
  }

  /** A damaged value may have been damaged on the way: it is asked for once more, past all caches. */
  private async requestAnew(resource: Resource): Promise<void> {
    this.damaged.add(resource);
    const controller = new AbortController();
    const server = this.serverOf(resource);
    this.requests.set(controller, { server, resources: [resource] });
    this.loading.set(resource, controller);
    resource.state = "loading";
    try {
      const bytes = await server.get(resource.key, controller.signal, true);
      await this.prepare(resource, bytes, controller.signal);
    } catch (error) {
      this.release(resource);
      const known = asFarfieldError(error, resource.key);
      if (known.tag === "missing") this.fail(resource, known);
    } finally {
      this.requests.delete(controller);
      this.pump();
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

/** Things by what `of` gives for them, in order. */
function grouped<Item, Group>(items: readonly Item[], of: (item: Item) => Group): Map<Group, Item[]> {
  const groups = new Map<Group, Item[]>();
  for (const item of items) {
    const group = of(item);
    const known = groups.get(group);
    if (known) known.push(item);
    else groups.set(group, [item]);
  }
  return groups;
}
