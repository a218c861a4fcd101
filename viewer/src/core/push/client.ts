import { Backoff } from "../backoff.js";
import { isTexture } from "../keys.js";
import type { Loader, Push } from "../loader.js";
import type { Resource } from "../resource.js";
import type { Server } from "../servers.js";
import { isNeeded, type Want } from "../wants.js";
import { Connection, type Hello } from "./connection.js";
import { EarlyValues } from "./early.js";
import { shared, type ViewMessage } from "./messages.js";

/** Milliseconds between two looks at what is to be said or done; views go out ten times a second at most. */
const TICK_MS = 100;
/** After which the same view is said again: a server ends a session that is silent for a minute. */
const AGAIN_MS = 15_000;
/** After which a view that has not been seen again is one at rest. */
const REST_MS = 500;
/** Code of a close: no session is free. */
const TRY_LATER = 1013;
/**
 * Without anything that the picture needs for so long or, at rest, without all of it, the loader asks for that itself: half a second of the link is under way in front of
 * what is urgent, a look of a busy server takes another, and a piece 3 s of a link of 5 kB a second; slower ones do without sessions.
 */
const PATIENCE_MS = 3000;
const PIECE_BYTES = 16 << 10;
/** Sessions in a row that brought nothing, with a server that answers, after which no other is begun: a proxy may not let them through. */
const MOST_VAIN = 3;
/** Keys that a server may take to be held before it is told of all that are not: it ends sessions that hold 200,000. */
const MOST_TOLD = 100_000;

export interface PushParts {
  /** Where the manifest is. */
  readonly server: Server;
  readonly loader: Loader;
  /** What is known by a key; null: nothing, or nothing yet. */
  readonly find: (key: string) => Resource | null;
  /** Where images go that are not known to be drawn by themselves: those of near geometry, of which the loader knows nothing. */
  readonly images: Images;
  /** Of the newest manifest that is known. */
  readonly generation: () => number;
  /** What the server wants to hear before it begins a session. */
  readonly token: () => string;
  /** The server shows another generation. */
  readonly outdated: () => void;
}

/** Images by key. */
export interface Images {
  put(key: string, value: Uint8Array): void;
  /** Of those that are there. */
  keys(): string[];
  /** Those that are drawn by themselves, as is found by now, and that nothing has had a use for; they are kept no longer. */
  taken(find: (key: string) => Resource | null): [Resource, Uint8Array][];
}

/**
 * Keeps a session with the server, in which that decides what to send, and gives what comes to the loader (spec/stream.md). The loader
 * goes on by itself wherever a session does not serve it: before one has begun, between two, when the server knows of nothing more, and
 * when what the picture needs does not come.
 *
 * What the cache lets go is said only when it is wanted again and there is room: said at once, a server would send it again, to be let go
 * again.
 */
export class PushClient implements Push {
  private connection: Connection | null = null;
  private welcomed = false;
  private idle = false;
  /** Bytes of sessions that are over. */
  private bytesBefore = 0;
  private wanted = false;
  private vain = 0;
  private knocking = false;
  private readonly backoff = new Backoff(() => performance.now(), () => undefined);
  private readonly closing = new AbortController();
  private timer: ReturnType<typeof setInterval> | undefined;
  private view: ViewMessage | null = null;
  private seenAt = -Infinity;
  private movedAt = -Infinity;
  private said = "";
  private saidAt = -Infinity;
  /** What the server takes to be held, or on its way. */
  private told = new Set<string>();
  /** What is being sent, if it is of use, how many bytes of it are to come, and when it began or a piece of it came. */
  private coming: Resource | null = null;
  private left = 0;
  private cameAt = -Infinity;
  private readonly early = new EarlyValues();
  /** Since when the picture has needed something and, while the eye moves, nothing of that kind has come. */
  private waitingSince: number | null = null;
  private needed: ReadonlySet<Resource> = new Set();
  private readonly looked = (): void => this.look();

  constructor(private readonly parts: PushParts) {
    globalThis.document?.addEventListener("visibilitychange", this.looked);
  }

  /** Whether there is a session. */
  get on(): boolean {
    return this.welcomed;
  }

  /** Bytes that have come in sessions. */
  get bytes(): number {
    return this.bytesBefore + (this.connection?.bytes ?? 0);
  }

  /** Begins a session as soon as there can be one, or ends it. */
  turn(wanted: boolean): void {
    if (wanted === this.wanted) return;
    this.wanted = wanted;
    this.renew();
    clearInterval(this.timer);
    if (wanted) this.timer = setInterval(() => this.tick(), TICK_MS);
  }

  /** Ends the session and begins another: there is a newer generation. */
  renew(): void {
    this.vain = 0;
    this.leave();
    if (this.wanted) this.tick();
  }

  close(): void {
    globalThis.document?.removeEventListener("visibilitychange", this.looked);
    this.closing.abort();
    this.turn(false);
  }

  /** The picture is seen from there. */
  see(view: ViewMessage): void {
    if (!this.view || placeOf(view) !== placeOf(this.view)) this.movedAt = performance.now();
    this.view = view;
    this.seenAt = performance.now();
    this.sayView();
  }

  /** What there is a use for by now: says what of it has been dropped, and takes what came before the index told of it. */
  settle(wants: readonly Want[]): void {
    this.needed = new Set(wants.filter(({ urgency }) => isNeeded(urgency)).map(({ resource }) => resource));
    const lacks = [...this.needed].some((resource) => resource.state === "absent" || resource === this.coming);
    if (!lacks) this.waitingSince = null;
    else this.waitingSince ??= performance.now();
    if (!this.welcomed) return;
    this.unpack();
    const { loader } = this.parts;
    const gone = wants.filter((want) => want.resource.state === "absent" && this.told.has(want.resource.key) && loader.hasRoom(want));
    this.drop(gone.map(({ resource }) => resource.key));
    if (this.told.size > MOST_TOLD) this.forget(wants);
  }

  covers(ahead: boolean): boolean {
    return this.welcomed && !this.idle && (ahead || !this.isOverdue);
  }

  asks(resources: readonly Resource[]): void {
    if (this.welcomed) this.add(resources.map(({ key }) => key));
  }

  private get isOverdue(): boolean {
    return this.waitingSince !== null && performance.now() > this.waitingSince + PATIENCE_MS;
  }

  /** A page that nobody sees needs nothing sent. */
  private look(): void {
    if (globalThis.document.hidden) this.leave();
    else if (this.wanted) this.tick();
  }

  private tick(): void {
    if (!this.connection) return void this.begin();
    this.sayView();
    if (!this.welcomed || !this.isOverdue) return;
    // In the midst of a value no server pauses: nobody is there any more.
    if (this.coming && this.needed.has(this.coming) && performance.now() > this.cameAt + PATIENCE_MS) this.end("the server is silent");
    else this.parts.loader.pump();
  }

  private async begin(): Promise<void> {
    const { source, reachable } = this.parts.server;
    const may = this.vain < MOST_VAIN && reachable && this.backoff.wait === 0 && !this.knocking && !globalThis.document?.hidden;
    if (!may || !source.stream) return;
    if (this.backoff.failures > 0 && !(await this.knock())) return;
    if (!this.wanted || this.connection || !source.stream) return;
    this.connection = new Connection(source.stream, () => this.hello(), {
      welcome: (found) => this.welcome(found),
      begun: (key, bytes) => this.start(key, bytes),
      came: (_, bytes) => this.came(bytes),
      whole: (key, value) => this.finish(key, value),
      cancelled: (key) => this.cancel(key),
      missing: (key) => this.miss(key),
      idle: () => this.rest(),
      ended: (why, code) => this.end(why, code),
    });
  }

  private hello(): Hello {
    const [holds = []] = shared(this.held());
    this.told = new Set(holds);
    return { generation: this.parts.generation(), token: this.parts.token(), holds };
  }

  private held(): string[] {
    return [...this.parts.images.keys(), ...[...this.parts.loader.holding()].map(({ key }) => key)];
  }

  /** Whether the server answers otherwise: else a page would try for sessions while there is nobody. */
  private async knock(): Promise<boolean> {
    this.knocking = true;
    try {
      await this.parts.server.source.knock(this.closing.signal);
      return true;
    } catch {
      this.backoff.failed("no answer");
      return false;
    } finally {
      this.knocking = false;
    }
  }

  private welcome(generation: number): void {
    if (generation !== this.parts.generation()) {
      this.end("another generation");
      this.parts.outdated();
      return;
    }
    this.welcomed = true;
    if (this.waitingSince !== null) this.waitingSince = performance.now();
    this.add(this.held());
    this.sayView();
  }

  private start(key: string, bytes: number): void {
    this.told.add(key);
    this.idle = false;
    const resource = this.parts.find(key);
    // What has been asked for meanwhile, or is of another generation, is let pass.
    this.coming = resource && this.parts.loader.awaits(resource, bytes) ? resource : null;
    this.left = bytes;
    this.cameAt = performance.now();
  }

  private came(bytes: number): void {
    if (!this.coming) return;
    this.left -= bytes;
    this.parts.loader.link.acknowledged(performance.now() / 1000, bytes);
    // A server that trickles is none.
    if (this.left > 0 && bytes < PIECE_BYTES) return;
    this.cameAt = performance.now();
    // Who stands waits for all of the picture, while a server also sends what might be seen next.
    if (this.cameAt < this.movedAt + REST_MS && this.waitingSince !== null && this.needed.has(this.coming)) this.waitingSince = this.cameAt;
  }

  private finish(key: string, value: Uint8Array): void {
    this.vain = 0;
    this.backoff.succeeded();
    const { coming } = this;
    this.coming = null;
    if (coming) this.parts.loader.deliver(coming, value);
    // An image of near geometry, or one that is drawn by itself, if the index does not tell of it yet.
    else if (isTexture(key)) this.parts.images.put(key, value);
    else if (!this.parts.find(key)) this.early.keep(key, value);
  }

  private cancel(key: string): void {
    this.told.delete(key);
    this.giveUp();
  }

  /** What is being sent does not come. */
  private giveUp(): void {
    if (!this.coming) return;
    this.parts.loader.link.givenUp(this.left);
    this.parts.loader.release(this.coming);
    this.coming = null;
  }

  private miss(key: string): void {
    const resource = this.parts.find(key);
    this.told.add(key);
    // Who asks learns why; what nobody can ask for is not missed.
    if (resource && !resource.isPushed && this.parts.loader.awaits(resource, 0)) this.parts.loader.deliver(resource, null);
  }

  private rest(): void {
    this.vain = 0;
    this.idle = true;
    this.parts.loader.pump();
  }

  private end(why: string, code = 0): void {
    if (code !== TRY_LATER) this.vain++;
    this.backoff.failed(why);
    this.leave();
  }

  /** Ends what there is of a session; the loader goes on. */
  private leave(): void {
    const { connection } = this;
    if (!connection) return;
    connection.close();
    this.bytesBefore += connection.bytes;
    this.connection = null;
    this.welcomed = this.idle = false;
    this.said = "";
    this.told.clear();
    this.giveUp();
    this.parts.loader.pump();
  }

  /** Where the picture is seen from, if that is news, or nothing has been said for a while. */
  private sayView(): void {
    const now = performance.now();
    if (!this.welcomed || !this.view || now < this.saidAt + TICK_MS) return;
    const view = now > this.seenAt + REST_MS ? resting(this.view) : this.view;
    const text = JSON.stringify(view);
    if (text === this.said && now < this.saidAt + AGAIN_MS) return;
    this.said = text;
    this.saidAt = now;
    this.connection!.view(view);
  }

  private add(keys: readonly string[]): void {
    for (const share of shared(keys.filter((key) => !this.told.has(key)))) this.connection!.add(share);
    for (const key of keys) this.told.add(key);
  }

  private drop(keys: readonly string[]): void {
    for (const share of shared(keys)) this.connection!.drop(share);
    for (const key of keys) this.told.delete(key);
  }

  /** Says of everything that is neither held nor wanted that it is not. */
  private forget(wants: readonly Want[]): void {
    const known = new Set([...this.held(), ...wants.map(({ resource }) => resource.key)]);
    this.drop([...this.told].filter((key) => !known.has(key)));
  }

  private unpack(): void {
    const { find, loader, images } = this.parts;
    for (const [resource, value] of [...this.early.taken(find), ...images.taken(find)]) if (loader.awaits(resource, 0)) loader.deliver(resource, value);
  }
}

function placeOf({ eye, forward }: ViewMessage): string {
  return [...eye, ...forward].join();
}

function resting(view: ViewMessage): ViewMessage {
  return { ...view, velocity: [0, 0, 0], acceleration: [0, 0, 0], turning: 0 };
}
