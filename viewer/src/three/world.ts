import { Group, Object3D, Scene, Vector2, type Camera, type WebGLRenderer } from "three";
import { Backoff, type Connection } from "../core/backoff.js";
import { DecodePool, type WorkerMaker } from "../core/decode/pool.js";
import { asFarfieldError, type FarfieldError } from "../core/errors.js";
import { Emitter } from "../core/events.js";
import { Fetcher } from "../core/fetch.js";
import { sameFrame, type Manifest } from "../core/manifest.js";
import { Server, Servers } from "../core/servers.js";
import type { Source } from "../core/source.js";
import { WorldIndex } from "../core/world.js";
import { Air } from "./air.js";
import { Frame } from "./frame.js";
import { Generations } from "./generations.js";
import { LightUniforms } from "./light.js";
import { openManifest, sourceOf } from "./opening.js";
import { defaultOptions, maySession, withChanges, type OptionChanges, type WorldOptions } from "./options.js";
import { MovingObjects } from "./moving.js";
import { Pace } from "./pace.js";
import { Picker, type Picked } from "./picker.js";
import { Session } from "./session.js";
import { Shadows } from "./shadows.js";
import { statsOf, type WorldStats } from "./stats.js";
import { viewpointOf } from "./viewpoint.js";
import { makeWorker } from "./worker.js";

/** What a world tells. */
export interface FarfieldEvents {
  /** The manifest has been read. */
  ready: Manifest;
  /** A newer generation has taken the place of the one that was shown. */
  generation: Manifest;
  /** The world cannot be shown. */
  failed: FarfieldError;
  /** A value is missing or damaged; its parent stands in. */
  bad: { readonly key: string; readonly error: FarfieldError };
  /** A server has gone away or come back; `part` is its address, or null when it is the one that the manifest came from. */
  connection: Connection & { readonly part: string | null };
  /** Something came in: it is time for another frame. */
  arrived: undefined;
}

/**
 * A baked world as an object of a three.js scene. Its own frame is local metres, z up: place and turn it as you like
 * (uniform scale only). Call `update` before each `renderer.render`; works with perspective cameras.
 */
export class FarfieldWorld extends Object3D {
  readonly events = new Emitter<FarfieldEvents>();
  readonly source: Source;
  options: WorldOptions;
  private session: Session | null = null;
  private picker: Picker | null = null;
  private generations: Generations | null = null;
  private readonly inner = new Scene();
  private readonly group = new Group();
  private readonly moving = new MovingObjects();
  private readonly light = new LightUniforms();
  private readonly air = new Air();
  private readonly shadows = new Shadows();
  private readonly frame = new Frame(this.light, this.air, this.shadows);
  private readonly pool: DecodePool;
  private readonly home: Server;
  private servers: Servers | null = null;
  private readonly closing = new AbortController();
  private readonly waiting: (() => void)[] = [];
  private renderer: WebGLRenderer | null = null;
  private largestPoint = 64;
  private readonly pace: Pace;
  private bad = 0;
  private lastCamera = "";
  private planDirty = true;
  /** Something has been uploaded since the last plan. */
  private arrived = false;
  private drawDirty = true;
  /** The camera or the options have changed: nothing puts drawing off. */
  private mustDraw = true;

  /** url: address of the folder that holds world.json, of world.json, or of an archive (….farfield). */
  constructor(url: string | URL, options: OptionChanges = {}, maker: WorkerMaker | null = makeWorker) {
    super();
    this.options = withChanges(defaultOptions(), options);
    this.pace = new Pace(this.options, () => this.events.emit("arrived", undefined));
    this.source = sourceOf(url);
    this.pool = new DecodePool(maker);
    this.home = this.serverOf(this.source, null, this.closing.signal);
    this.inner.add(this.group);
    this.inner.matrixWorldAutoUpdate = false;
    this.frame.addTo(this);
    this.applyOptions();
    void this.open();
  }

  /** The manifest, once read. */
  get manifest(): Manifest | null {
    return this.session?.index.manifest ?? null;
  }

  /** Metres from the eye of the last update to the nearest thing of the world, by its cells' bounds; null: unknown. */
  get clearance(): number | null {
    return this.session?.clearance ?? null;
  }

  get stats(): WorldStats {
    const { moving, pace } = this;
    const facts = statsOf(this.session, this.source, this.options, this.bad);
    return { ...facts, reduction: pace.reduction, moving_objects: moving.count, moving_triangles: moving.triangles };
  }

  setOptions(changes: OptionChanges): void {
    const { patches, token } = this.options;
    this.options = withChanges(this.options, changes);
    // Tiles have been joined already, or not.
    if (this.options.patches !== patches) this.session?.lost();
    if (this.options.token !== token) this.session?.push?.renew();
    this.applyOptions();
  }

  /**
   * Chooses, fetches and draws what the camera sees into the world's own frame; to be called before each
   * `renderer.render`. Returns whether the frame is different from the last time. `mayDraw` false puts drawing off, so that
   * a slow card does not draw every tile's arrival.
   */
  update(camera: Camera, renderer: WebGLRenderer, mayDraw = true): boolean {
    const { session } = this;
    if (!session) return false;
    const start = performance.now();
    this.meet(renderer);
    camera.updateMatrixWorld();
    this.updateWorldMatrix(true, false);
    const size = renderer.getDrawingBufferSize(new Vector2());
    if (this.moved(camera, size)) {
      session.moved();
      this.pace.moved(start);
      this.invalidate();
    }
    // Who waits for the complete picture wants all of it.
    if (this.pace.advance(start, this.waiting.length > 0)) this.invalidate();
    if (session.loader.install(this.options.uploadBytes)) this.arrived = true;
    const may = mayDraw || this.mustDraw || session.pending === 0;
    // What was ordered has all come: what else the picture wants is put in order by a plan of what there is now.
    if (this.planDirty || (this.arrived && (may || session.underWay === 0))) this.choose(session, camera, renderer, size);
    if (session.shadowsDue) this.drawDirty = true;
    const drawing = this.drawDirty && may;
    if (drawing) {
      this.drawDirty = this.mustDraw = false;
      session.draw(camera, this.largestPoint, size.x);
      // Shadow maps that could wait are drawn with the next frames.
      if (this.shadows.stale > 0) this.drawDirty = true;
    }
    const different = this.show(session, camera, drawing);
    if (drawing) this.pace.submitted(start);
    this.settle(session);
    return different;
  }

  /**
   * Shows an object, with all its meshes, that may move from one update to the next: in local metres, z up, hidden by the world and hiding
   * it, lit like its near geometry. It belongs to the world from then on; change its position, rotation, scale or `visible` as you like. Only it is
   * drawn anew then, not the world. Throws `limit` beyond 64 objects, `unsupported` for anything but plain meshes.
   */
  addMoving(object: Object3D): void {
    this.moving.add(object);
    this.events.emit("arrived", undefined);
  }

  /** Shows an object no longer. */
  removeMoving(object: Object3D): void {
    this.moving.remove(object);
    this.events.emit("arrived", undefined);
  }

  /** Fulfilled when everything that the current view wants, within its frustum, has been fetched and drawn. */
  whenComplete(): Promise<void> {
    this.invalidate();
    return new Promise((resolve) => this.waiting.push(resolve));
  }

  /**
   * What is at pixel (x, y) of the picture that was drawn last, counted in pixels of the renderer's drawing buffer from its upper left corner: the object and
   * its attributes, which are fetched for that; null: nothing of the world is there. What moves is looked through. Rejects with `network`, `missing`, `corrupt`
   * or `aborted`.
   */
  async pick(x: number, y: number, signal?: AbortSignal): Promise<Picked | null> {
    const { session, picker, renderer } = this;
    if (!session?.picture || !picker || !renderer) return null;
    const { signal: closing } = this.closing;
    const own = new AbortController();
    const abort = (): void => own.abort();
    const ends = signal ? [closing, signal] : [closing];
    for (const end of ends) {
      if (end.aborted) abort();
      end.addEventListener("abort", abort);
    }
    try {
      return await picker.pick(session.picture, renderer, x, y, own.signal);
    } finally {
      for (const end of ends) end.removeEventListener("abort", abort);
    }
  }

  /** Whether a value is held, ready to be drawn or uploaded. */
  holds(key: string): boolean {
    return this.session?.loader.cache.has(key) ?? false;
  }

  /** Plans and draws again at the next update even if nothing has changed. */
  invalidate(): void {
    this.planDirty = this.drawDirty = this.mustDraw = true;
  }

  /** Tries again at once what failed for want of an answer. */
  retryNow(): void {
    for (const { backoff } of this.servers?.all ?? [this.home]) backoff.hurry();
  }

  /** Looks whether there is a newer generation, which is then shown; for servers that do not tell (docs/viewer.md). */
  async refresh(): Promise<boolean> {
    return (await this.generations?.look()) ?? false;
  }

  override dispose(): void {
    this.closing.abort();
    this.moving.dispose();
    this.pace.dispose();
    this.generations?.close();
    this.session?.dispose();
    this.session = null;
    this.pool.dispose();
    this.shadows.clear();
    this.frame.dispose();
  }

  private async open(): Promise<void> {
    const { source, home } = this;
    const { signal } = this.closing;
    try {
      const manifest = await openManifest(source, home.backoff, signal);
      if (signal.aborted) return;
      this.begin(manifest);
      const newest = (): Manifest | null => this.session?.newest ?? null;
      const found = (newer: Manifest): void => this.renew(newer);
      const unreadable = (error: FarfieldError): void => this.events.emit("bad", { key: "world.json", error });
      this.generations = new Generations({ home, signal, newest, found, unreadable });
      this.events.emit("ready", manifest);
    } catch (thrown) {
      const error = asFarfieldError(thrown, this.source.base);
      if (error.tag !== "aborted") this.events.emit("failed", error);
    }
  }

  private begin(manifest: Manifest): void {
    const servers = new Servers(this.home, manifest, (address, signal) => this.serverOf(new Fetcher(address), address, signal));
    this.servers = servers;
    const index = new WorldIndex(manifest, servers, {
      bad: (key, error, of) => this.doubt(key, error, () => of.manifest === this.session?.newest),
      grown: () => {
        this.session?.grown();
        this.changed();
      },
    });
    const { pool, light, group, frame, shadows, inner } = this;
    const renderer = (): WebGLRenderer => this.renderer!;
    const options = (): WorldOptions => this.pace.options;
    const parts = { index, servers, pool, light, group, scene: inner, frame, shadows, renderer, options };
    const session = new Session(parts, {
      bad: (resource, error) => this.doubt(resource.key, error, () => this.session?.isNewest(resource) ?? false),
      arrived: () => this.events.emit("arrived", undefined),
      outdated: () => void this.refresh(),
      unforeseen: () => this.changed(),
      lacking: () => {
        this.drawDirty = true;
        this.events.emit("arrived", undefined);
      },
    });
    this.session = session;
    this.picker = new Picker(servers, manifest, frame);
    session.push?.turn(maySession(this.options));
    this.moving.drawWith((part) => session.near.materialOfMoving(part));
    this.changed();
  }

  /** What asks a server, knocks when it is away, and tells of it; `part` as in the event `connection`. */
  private serverOf(source: Source, part: string | null, signal: AbortSignal): Server {
    const changed = (connection: Connection): void => {
      this.events.emit("connection", { ...connection, part });
      this.changed();
    };
    const back = (): void => {
      this.session?.loader.pump();
      this.changed();
    };
    return new Server(source, new Backoff(() => performance.now(), changed), signal, back, part === null);
  }

  /** Shows a newer generation: in the place of the present one where that is possible, else from the beginning. */
  private renew(manifest: Manifest): void {
    const session = this.session!;
    if (sameFrame(manifest, session.index.manifest)) session.follow(manifest);
    else {
      session.dispose();
      this.begin(manifest);
      this.events.emit("generation", manifest);
    }
    this.changed();
  }

  private moved(camera: Camera, size: Vector2): boolean {
    const matrices = [camera.matrixWorld, camera.projectionMatrix, this.matrixWorld];
    const now = [...matrices.flatMap(({ elements }) => elements), size.x, size.y].join();
    const moved = now !== this.lastCamera;
    this.lastCamera = now;
    return moved;
  }

  /** Shows the world and what moves over it, if either is different or goes over still, which it returns. */
  private show(session: Session, camera: Camera, fresh: boolean): boolean {
    const { moving, frame } = this;
    const moved = moving.advance();
    const viewpoint = session.drawn;
    if (!viewpoint || !(fresh || moved || frame.isFading)) return false;
    moving.placeFor(viewpoint.eye);
    // Who waits for the complete picture gets it without what was before.
    const atOnce = this.waiting.length > 0 && session.pending === 0;
    frame.show(this.renderer!, camera, viewpoint, moving.count > 0 ? moving.scene : null, { fresh, atOnce });
    return true;
  }

  private choose(session: Session, camera: Camera, renderer: WebGLRenderer, size: Vector2): void {
    this.planDirty = this.arrived = false;
    const framed = this.frame.resize(renderer, size.x, size.y, this.pace.options.supersampling);
    const viewpoint = viewpointOf(camera, this.matrixWorld, framed.width, framed.height);
    this.air.see(viewpoint, framed.width / size.x);
    const different = session.choose(viewpoint, Math.min(size.x, framed.width));
    if (different.picture) this.drawDirty = true;
    if (different.detail) this.changed();
    if (different.generation) this.events.emit("generation", session.index.manifest);
  }

  /** Fulfils what waits for a complete picture, if the one drawn last is. */
  private settle(session: Session): void {
    const drawn = !this.planDirty && !this.arrived && !this.drawDirty && this.pace.reduction === 0;
    const settled = drawn && !this.frame.isFading && !this.generations?.busy;
    if (this.waiting.length === 0 || !settled || !session.complete) return;
    for (const resolve of this.waiting.splice(0)) resolve();
  }

  /** Uses this renderer from now on. */
  private meet(renderer: WebGLRenderer): void {
    if (this.renderer === renderer) return;
    this.renderer = renderer;
    const gl = renderer.getContext() as WebGL2RenderingContext;
    this.pace.meet(gl);
    this.largestPoint = (gl.getParameter(gl.ALIASED_POINT_SIZE_RANGE) as Float32Array)[1] ?? 64;
    renderer.domElement.addEventListener("webglcontextrestored", () => {
      this.session?.lost();
      this.invalidate();
    });
  }

  /** What is missing may belong to a generation that has been replaced: then the newer one is shown, and all is well. */
  private async doubt(key: string, error: FarfieldError, isNewest: () => boolean): Promise<void> {
    const replaced = error.tag === "missing" && (!isNewest() || (await this.generations?.explains()));
    if (replaced) this.changed();
    else this.report(key, error);
  }

  private report(key: string, error: FarfieldError): void {
    this.bad++;
    this.events.emit("bad", { key, error });
    if (this.session?.hopeless) this.events.emit("failed", error);
    this.changed();
  }

  private changed(): void {
    this.planDirty = true;
    this.events.emit("arrived", undefined);
  }

  private applyOptions(): void {
    this.pace.ask(this.options);
    this.light.set(this.options.light, this.options.sky);
    this.air.set(this.options);
    this.frame.fade = this.options.fade;
    this.frame.shutter = this.options.shutter;
    if (this.session) {
      this.session.loader.budget = this.options.cacheBytes;
      this.session.push?.turn(maySession(this.options));
    }
    this.invalidate();
    this.changed();
  }
}
