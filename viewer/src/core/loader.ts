import { Cache } from "./cache.js";
import { asFarfieldError, type FarfieldError } from "./errors.js";
import type { Resource } from "./resource.js";
import type { Server, Servers } from "./servers.js";
import { Sizes, SURE } from "./sizes.js";
import { valueOf, type Found } from "./source.js";
import { Stock } from "./stock.js";
import { Link } from "./stream/link.js";
import { isNeeded, URGENCY, type Want } from "./wants.js";

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
  /** A value that the picture needs has been asked for, and so will be what it refers to. */
  expects?(resource: Resource): void;
}

/** What sees to values in the loader's place while it can (core/push). */
export interface Push {
  /** Whether what the picture needs, or what it does not need now, is left to it. */
  covers(ahead: boolean): boolean;
  /** The loader asks for these itself. */
  asks(resources: readonly Resource[]): void;
}

export interface LoaderEvents {
  readonly bad: (resource: Resource, error: FarfieldError) => void;
  /** Something came in: it is time for another frame. */
  readonly arrived: () => void;
  /** A mesh, a board of one, or geometry of a cell above the leaves came that no plan had a use for: the next one may have, to let it stand in. */
  readonly unforeseen?: () => void;
}

/** To one server at once: as many as browsers open connections to it. */
const REQUESTS = 6;
/** To all of them, as far as each has two: more would only share the same line. */
const REQUESTS_TO_ALL = 24;
const REQUEST_BYTES = 256 << 10;
/**
 * Seconds of the link that are asked for ahead, so that what turns out to be more urgent does not wait for longer, large values apart;
 * bytes at least, as long as it is not known how fast it is as well; and how many requests share them.
 */
const ASKED_SECONDS = 0.5;
const ASKED_BYTES = 32 << 10;
const SHARES = 4;
/** Bytes of a value that has a request to itself, and how many such come at once: on a slow link the small ones go on beside them. */
const LARGE_BYTES = 1 << 20;
const LARGE_REQUESTS = 2;
/** Values under way and decoded but not uploaded, of all servers together; more would only grow old. */
const UNDER_WAY = 128;

/**
 * What the picture does not need now is fetched, decoded and uploaded each within a budget of its own, so that none of it
 * delays or drives out what the picture needs. Requests for it at once to a server: two keep a link of 20 Mbit/s and 40 ms
 * full, and what becomes urgent meanwhile waits for 100 ms of them.
 */
const REQUESTS_AHEAD = 2;
const REQUEST_BYTES_AHEAD = 128 << 10;
/** Bytes fetched and not decoded, as a share of the cache: there they would fill it about once. */
export const STOCK_SHARE = 1 / 12;
/** It is decoded, a few at once, while the cache is no fuller than this with what is to come. */
const DECODES_AHEAD = 3;
const DECODED_SHARE = 0.7;
/** It is uploaded while no more of the cache is on the graphics card, by at most this share of a frame's bytes. */
const UPLOADED_SHARE = 0.6;
const FRAME_SHARE = 0.25;

/** What is under way from one server. */
interface Request {
  readonly server: Server;
  readonly resources: readonly Resource[];
  /** Whether the picture did not need any of it when it was asked for. */
  readonly ahead: boolean;
}

/** What one server is asked for at once. */
interface Limits {
  readonly ahead: boolean;
  readonly requests: number;
  readonly values: number;
}

/** Fetches what is wanted, most urgent first, decodes it, and keeps it within a budget of bytes. */
export class Loader {
  readonly cache: Cache;
  readonly sizes = new Sizes();
  readonly stock: Stock;
  /** How fast values come. */
  readonly link = new Link();
  /** Null: everything is asked for. */
  push: Push | null = null;
  /** Whether the index of what is in the picture is still on its way: nobody knows yet what adds most, so little is asked for beside it. */
  isLearning = false;
  private wants: readonly Want[] = [];
  private urgencies: ReadonlyMap<Resource, number> = new Map();
  /** What the picture needs, and what it does not need now, by server. */
  private queues: ReadonlyMap<Server, readonly Want[]> = new Map();
  private queuesAhead: ReadonlyMap<Server, readonly Want[]> = new Map();
  private plan = 0;
  /** Whether what is in the picture may go beyond the budget. */
  private beyond = false;
  /** Bytes of what is under way and will be decoded, as far as can be told. */
  private coming = 0;
  /** Bytes, as they come, of what is under way to the stock. */
  private arriving = 0;
  /** How much of what is decoded the picture waits for. */
  private waiting = 0;
  /** Bytes of what the plan uses, there or under way. */
  private taken = 0;
  private readonly requests = new Map<AbortController, Request>();
  private readonly loading = new Map<Resource, AbortController>();
  private readonly decoding = new Set<Resource>();
  private readonly ready = new Map<Resource, Prepared>();
  /** Bytes on the graphics card. */
  uploaded = 0;
  private readonly closing = new AbortController();
  private readonly damaged = new Set<Resource>();
  private readonly homes = new WeakMap<Resource, Server>();

  constructor(
    private readonly servers: Servers,
    private readonly preparer: Preparer,
    budget: number,
    private readonly events: LoaderEvents,
  ) {
    this.cache = new Cache(budget, (resource) => this.drop(resource));
    this.stock = new Stock(budget * STOCK_SHARE);
  }

  /** Bytes that what is decoded may take; what is fetched ahead takes a share of as much besides. */
  set budget(bytes: number) {
    this.cache.budget = bytes;
    this.stock.budget = bytes * STOCK_SHARE;
  }

  /** Values asked for, or being decoded. */
  get asked(): number {
    return this.loading.size;
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
    this.urgencies = new Map(wants.map(({ resource, urgency }) => [resource, urgency]));
    const serverOf = ({ resource }: Want): Server => this.serverOf(resource);
    this.queues = grouped(wants.filter(({ urgency }) => isNeeded(urgency)), serverOf);
    this.queuesAhead = grouped(wants.filter(({ urgency }) => !isNeeded(urgency)), serverOf);
    this.plan = number;
    for (const { resource, urgency } of wants) {
      if (isNeeded(urgency)) this.cache.use(resource, number);
    }
    for (const resource of drawn) this.cache.use(resource, number);
    this.cache.trim(number);
    this.stock.trim((resource) => this.urgencies.has(resource));
    for (const [controller, { resources }] of this.requests) {
      if (!resources.some((resource) => this.urgencies.has(resource))) controller.abort();
    }
    this.pump();
  }

  /**
   * Uploads what is decoded, most urgent first, until `bytes` have been, of what the picture does not need now fewer; returns
   * whether the picture may be different for it.
   */
  install(bytes: number): boolean {
    if (this.ready.size === 0) return false;
    let left = bytes;
    let leftAhead = Math.min(bytes * FRAME_SHARE, this.cache.budget * UPLOADED_SHARE - this.uploaded);
    let useful = false;
    for (const { resource, urgency } of this.wants) {
      if (resource.state !== "ready") continue;
      if (left <= 0 || (!isNeeded(urgency) && leftAhead <= 0)) break;
      left -= resource.size;
      if (!isNeeded(urgency)) leftAhead -= resource.size;
      useful ||= urgency !== URGENCY.ahead && urgency !== URGENCY.unseen;
      this.hold(resource);
    }
    this.pump();
    return useful;
  }

  /** What is held or on its way. */
  *holding(): Iterable<Resource> {
    yield* this.cache.resources;
    yield* this.stock.resources;
    yield* this.loading.keys();
  }

  /** Whether there is room for what is not there. */
  hasRoom({ resource, urgency }: Want): boolean {
    return isNeeded(urgency) ? this.fits(resource, false) : this.fitsStock(resource);
  }

  /** So many bytes of a value come without having been asked for; false: it is there, or has been asked for. */
  awaits(resource: Resource, bytes: number): boolean {
    if (resource.state !== "absent") return false;
    resource.state = "loading";
    this.loading.set(resource, this.closing);
    this.link.sent(performance.now() / 1000, bytes);
    return true;
  }

  /** It has come; null: it cannot, and is asked for to learn why. */
  deliver(resource: Resource, value: Uint8Array | null): void {
    if (!value) return void this.requestAnew(resource);
    this.loading.delete(resource);
    const alone = this.waiting === 0 && !this.isNeededFrom(null);
    if (isNeeded(this.urgencyOf(resource)) && this.fits(resource, alone)) {
      this.loading.set(resource, this.closing);
      void this.prepare(resource, value, this.closing.signal);
    } else this.putAside(resource, value);
    if (standsIn(resource) && !this.urgencies.has(resource)) this.events.unforeseen?.();
    this.pump();
  }

  /** Gives everything up. */
  clear(): void {
    for (const controller of this.requests.keys()) controller.abort();
    this.closing.abort();
    this.wants = [];
    this.urgencies = this.queues = this.queuesAhead = new Map();
    this.stock.clear();
    this.cache.clear();
  }

  /** Starts as many requests as there is room for. A server that is slow leaves room for the others. */
  pump(): void {
    const { length } = this.servers.all;
    const requests = Math.min(REQUESTS, Math.max(2, Math.floor(REQUESTS_TO_ALL / length)));
    this.taken = this.cache.inUse(this.plan);
    this.coming = this.arriving = this.waiting = 0;
    for (const resource of this.loading.keys()) this.expect(resource);
    for (const resource of this.ready.keys()) if (isNeeded(this.urgencyOf(resource))) this.waiting++;
    this.decodeStocked();
    const values = UNDER_WAY / length;
    for (const ahead of [false, true]) {
      if (this.push?.covers(ahead)) continue;
      for (const [server, wants] of ahead ? this.queuesAhead : this.queues) {
        // Requests ahead are smaller, so there may be room for one of them sooner: the link would be theirs.
        if (!ahead || !this.isWaitedFor(server)) this.ask(server, wants, { ahead, requests, values });
      }
    }
  }

  /** Whether the picture needs something of a server that could be asked for and has not been yet. */
  private isWaitedFor(server: Server): boolean {
    if (this.push?.covers(false)) return false;
    const could = ({ resource }: Want): boolean =>
      resource.state === "absent" && !isLarge(resource) && this.servers.mayAsk(resource) && this.fits(resource, false);
    return (this.queues.get(server) ?? []).some(could);
  }

  /** Starts requests to one server. */
  private ask(server: Server, wants: readonly Want[], { ahead, requests, values }: Limits): void {
    const asked = [...this.requests.values()].filter((request) => request.server === server);
    const room = this.isLearning ? ASKED_BYTES : Math.max(this.link.bandwidth * ASKED_SECONDS, ASKED_BYTES);
    const limit = Math.min(ahead ? REQUEST_BYTES_AHEAD : REQUEST_BYTES, room / SHARES);
    // On a slow link more requests would not come sooner, but all of them late.
    const enough = server.source.batchKeys > 1 ? 1 + Math.ceil((this.link.bandwidth * this.link.latency) / limit) : requests;
    let free = Math.min(requests, enough) - asked.length;
    if (ahead) free = Math.min(free, REQUESTS_AHEAD - asked.filter((request) => request.ahead).length);
    // What does not fit still comes, one at a time: it may be that all that stands in its way waits for it.
    let alone = !ahead && this.waiting === 0 && !this.isNeededFrom(server);
    let left = values - asked.reduce((sum, { resources }) => sum + resources.length, 0);
    let large = (ahead ? 1 : LARGE_REQUESTS) - asked.filter(({ resources }) => resources.some(isLarge)).length;
    for (let next = 0; server.reachable && free > 0 && left > 0 && this.loading.size + this.waiting < UNDER_WAY; free--) {
      if (this.smallUnderWay() >= room) return;
      const chosen: Resource[] = [];
      let bytes = 0;
      const most = Math.min(server.source.batchKeys, left);
      for (; next < wants.length && chosen.length < most && bytes < limit; next++) {
        const { resource } = wants[next]!;
        if (resource.state !== "absent" || !this.servers.mayAsk(resource)) continue;
        if (isLarge(resource)) {
          if (large <= 0) continue;
          // Alone: the others would wait for it.
          if (chosen.length > 0) break;
        }
        if (!(ahead ? this.fitsStock(resource) : this.fits(resource, alone && chosen.length === 0))) {
          // What is more urgent is not to wait until smaller things of this server have filled the room.
          if (!ahead) break;
          continue;
        }
        chosen.push(resource);
        bytes += resource.bytes;
        this.expect(resource);
      }
      if (chosen.length === 0) return;
      if (isLarge(chosen[0]!)) large--;
      left -= chosen.length;
      alone = false;
      void this.request(server, chosen, ahead);
    }
  }

  /** Bytes asked for, large values apart, which have requests of their own. */
  private smallUnderWay(): number {
    let bytes = 0;
    for (const { resources } of this.requests.values()) if (!isLarge(resources[0]!)) bytes += bytesOf(resources);
    return bytes;
  }

  /** Decodes what was fetched ahead: what the picture has come to need, and a few of the others while there is room. */
  private decodeStocked(): void {
    if (this.stock.count === 0) return;
    let free = DECODES_AHEAD - [...this.decoding].filter((resource) => !isNeeded(this.urgencyOf(resource))).length;
    let alone = this.waiting === 0 && !this.isNeededFrom(null);
    for (const { resource, urgency } of this.wants) {
      if (resource.state !== "fetched") continue;
      const ahead = !isNeeded(urgency);
      if (ahead ? free-- <= 0 || !this.fitsAhead(resource) : !this.fits(resource, alone)) return;
      alone = false;
      resource.state = "loading";
      this.loading.set(resource, this.closing);
      void this.prepare(resource, this.stock.take(resource), this.closing.signal);
      this.expect(resource);
    }
  }

  /** Whether something that the picture needs is under way from a server, or from any. */
  private isNeededFrom(server: Server | null): boolean {
    for (const resource of this.loading.keys()) {
      if (isNeeded(this.urgencyOf(resource)) && (server === null || this.serverOf(resource) === server)) return true;
    }
    return false;
  }

  private urgencyOf(resource: Resource): number {
    return this.urgencies.get(resource) ?? Infinity;
  }

  private serverOf(resource: Resource): Server {
    const server = this.homes.get(resource) ?? this.servers.of(resource.key);
    this.homes.set(resource, server);
    return server;
  }

  private expect(resource: Resource): void {
    if (!isNeeded(this.urgencyOf(resource)) && !this.decoding.has(resource)) {
      this.arriving += resource.bytes;
      return;
    }
    const size = this.sizes.of(resource);
    this.coming += size;
    if (resource.used >= this.plan) this.taken += size;
  }

  /**
   * What is needed for the picture waits until it fits beside what stands in for it, unless it is alone under way from its
   * server.
   */
  private fits(resource: Resource, alone: boolean): boolean {
    return this.taken + this.sizes.of(resource) <= this.cache.budget * SURE || alone || this.beyond;
  }

  /** What is not needed now is fetched while the stock has room for it ... */
  private fitsStock({ bytes }: Resource): boolean {
    return this.stock.bytes + this.arriving + bytes <= this.stock.budget;
  }

  /** ... and decoded while the cache has. */
  private fitsAhead(resource: Resource): boolean {
    return this.cache.bytes + this.coming + this.sizes.of(resource) < this.cache.budget * DECODED_SHARE;
  }

  private async request(server: Server, resources: Resource[], ahead: boolean): Promise<void> {
    const controller = new AbortController();
    this.requests.set(controller, { server, resources, ahead });
    for (const resource of resources) {
      resource.state = "loading";
      this.loading.set(resource, controller);
    }
    this.push?.asks(resources);
    const bytes = bytesOf(resources);
    this.link.sent(performance.now() / 1000, bytes);
    if (!ahead) for (const resource of resources) this.preparer.expects?.(resource);
    try {
      const answers = await server.getMany(resources.map(({ key }) => key), controller.signal);
      this.link.acknowledged(performance.now() / 1000, bytes);
      resources.forEach((resource, n) => this.arrive(resource, answers[n]!, controller.signal));
    } catch (error) {
      this.link.givenUp(bytes);
      const known = asFarfieldError(error, resources[0]!.key);
      for (const resource of resources) this.release(resource);
      if (known.tag === "missing") for (const resource of resources) this.fail(resource, known);
      else if (known.tag !== "aborted") server.failed(known.what);
    } finally {
      this.requests.delete(controller);
      this.pump();
    }
  }

  /** Decodes what the picture needs, and keeps the rest for later. */
  private arrive(resource: Resource, found: Found, signal: AbortSignal): void {
    if (isNeeded(this.urgencyOf(resource)) || !(found instanceof Uint8Array)) return void this.prepare(resource, found, signal);
    this.loading.delete(resource);
    this.putAside(resource, found);
  }

  /** Keeps a value as it came; one that does not fit goes. */
  private putAside(resource: Resource, value: Uint8Array): void {
    this.stock.put(resource, value);
    this.stock.trim((other) => this.urgencies.has(other));
    if (this.stock.bytes > this.stock.budget) this.stock.drop(resource);
  }

  private async prepare(resource: Resource, found: Found, signal: AbortSignal): Promise<void> {
    this.decoding.add(resource);
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
      else if (known.tag === "corrupt" && !resource.isPushed && !this.damaged.has(resource)) void this.requestAnew(resource);
      else this.fail(resource, known);
    } finally {
      this.decoding.delete(resource);
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
    this.requests.set(controller, { server, resources: [resource], ahead: false });
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
    this.uploaded += resource.size;
    resource.state = "held";
    resource.cell?.count(1);
  }

  private fail(resource: Resource, error: FarfieldError): void {
    resource.state = "bad";
    this.events.bad(resource, error);
  }

  /** It does not come. */
  release(resource: Resource): void {
    this.loading.delete(resource);
    if (resource.state === "loading") resource.state = "absent";
  }

  private drop(resource: Resource): void {
    if (resource.state === "held") {
      resource.cell?.count(-1);
      this.uploaded -= resource.size;
      this.preparer.dispose(resource, resource.payload);
    } else {
      this.ready.get(resource)?.discard?.();
      this.ready.delete(resource);
    }
    resource.payload = null;
    resource.state = "absent";
  }
}

function bytesOf(resources: readonly Resource[]): number {
  return resources.reduce((sum, { bytes }) => sum + bytes, 0);
}

function isLarge({ bytes }: Resource): boolean {
  return bytes > LARGE_BYTES;
}

function standsIn({ kind, cell }: Resource): boolean {
  return kind === "mesh" || kind === "impostor" || (kind === "geometry" && cell!.level > 0);
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
