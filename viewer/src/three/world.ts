import { Camera, Group, Object3D, Scene, type WebGLRenderer, Vector2 } from "three";
import { Backoff, type Connection } from "../core/backoff.js";
import type { Cell } from "../core/cell.js";
import { DecodePool, type WorkerMaker } from "../core/decode/pool.js";
import { asFarfieldError, FarfieldError } from "../core/errors.js";
import { Emitter } from "../core/events.js";
import { Fetcher } from "../core/fetch.js";
import { Loader } from "../core/loader.js";
import type { Manifest } from "../core/manifest.js";
import type { Resource } from "../core/resource.js";
import { makePlan, type Plan, type PlanView } from "../core/plan.js";
import { distanceTo } from "../core/vector.js";
import { listWants, URGENCY } from "../core/wants.js";
import { WorldIndex } from "../core/world.js";
import { CoarseningControl } from "./coarsening.js";
import { Frame } from "./frame.js";
import { LightUniforms, sunDirection } from "./light.js";
import { NearGeometry } from "./near/geometry.js";
import { TextureShelf } from "./near/textures.js";
import { defaultOptions, withChanges, type OptionChanges, type WorldOptions } from "./options.js";
import { ThreePreparer } from "./preparer.js";
import { Splats } from "./splats.js";
import type { WorldStats } from "./stats.js";
import { viewpointOf, type Viewpoint } from "./viewpoint.js";
import { makeWorker } from "./worker.js";

/** What a world tells. */
export interface FarfieldEvents {
  /** The manifest has been read. */
  ready: Manifest;
  /** The world cannot be shown. */
  failed: FarfieldError;
  /** A value is missing or damaged; its parent stands in. */
  bad: { readonly key: string; readonly error: FarfieldError };
  /** The server has gone away or come back. */
  connection: Connection;
  /** Something came in: it is time for another frame. */
  arrived: undefined;
}

/** What is open once the manifest has been read. */
interface Opened {
  readonly index: WorldIndex;
  readonly loader: Loader;
  readonly splats: Splats;
  readonly near: NearGeometry;
}

/**
 * A baked world as an object of a three.js scene. Its own frame is local metres, z up: place and turn it as you like
 * (uniform scale only). Call `update` before each `renderer.render`; works with perspective cameras.
 */
export class FarfieldWorld extends Object3D {
  readonly events = new Emitter<FarfieldEvents>();
  readonly fetcher: Fetcher;
  options: WorldOptions;
  private opened: Opened | null = null;
  private readonly inner = new Scene();
  private readonly group = new Group();
  private readonly frame = new Frame();
  private readonly light = new LightUniforms();
  private readonly pool: DecodePool;
  private readonly backoff: Backoff;
  private readonly closing = new AbortController();
  private readonly coarsening = new CoarseningControl();
  private readonly waiting: (() => void)[] = [];
  private renderer: WebGLRenderer | null = null;
  private plan: Plan | null = null;
  private planNumber = 0;
  /** What the picture of the last plan wants. */
  private seen: readonly Resource[] = [];
  private bad = 0;
  private planDirty = true;
  /** Something has been uploaded since the last plan. */
  private arrived = false;
  private drawDirty = true;
  /** The camera or the options have changed: nothing puts drawing off. */
  private mustDraw = true;
  private lastCamera = "";
  private viewpoint: Viewpoint | null = null;
  private largest = 64;

  /** url: address of the folder that holds world.json, or of world.json. */
  constructor(url: string | URL, options: OptionChanges = {}, maker: WorkerMaker | null = makeWorker) {
    super();
    this.options = withChanges(defaultOptions(), options);
    this.fetcher = new Fetcher(folderOf(url));
    this.pool = new DecodePool(maker);
    this.backoff = new Backoff(() => performance.now(), (connection) => this.events.emit("connection", connection));
    this.inner.add(this.group);
    this.inner.matrixWorldAutoUpdate = false;
    this.frame.addTo(this);
    this.applyOptions();
    void this.open();
  }

  /** The manifest, once read. */
  get manifest(): Manifest | null {
    return this.opened?.index.manifest ?? null;
  }

  setOptions(changes: OptionChanges): void {
    this.options = withChanges(this.options, changes);
    this.applyOptions();
  }

  /**
   * Chooses, fetches and draws what the camera sees into the world's own frame; to be called before each
   * `renderer.render`. Returns whether the frame is different from the last time. `mayDraw` false puts drawing off, so that
   * a slow card does not draw every tile's arrival.
   */
  update(camera: Camera, renderer: WebGLRenderer, mayDraw = true): boolean {
    if (!this.opened) return false;
    this.meet(renderer);
    camera.updateMatrixWorld();
    this.updateWorldMatrix(true, false);
    const size = renderer.getDrawingBufferSize(new Vector2());
    if (this.moved(camera, size)) this.invalidate();
    if (this.opened.loader.install(this.options.uploadBytes)) this.arrived = true;
    const may = mayDraw || this.mustDraw || this.pending === 0;
    if (this.planDirty || (this.arrived && may)) this.choose(this.opened, camera, renderer, size);
    const drawing = this.plan !== null && this.drawDirty && may;
    if (drawing) this.draw(this.opened, this.plan!, camera, renderer);
    this.settle(this.opened.index);
    return drawing;
  }

  /** Fulfilled when everything that the current view wants, within its frustum, has been fetched and drawn. */
  whenComplete(): Promise<void> {
    this.invalidate();
    return new Promise((resolve) => this.waiting.push(resolve));
  }

  /** Values that the picture wants and that have not arrived. */
  get pending(): number {
    let count = 0;
    for (const { state } of this.seen) if (state !== "held" && state !== "bad") count++;
    return count;
  }

  /** Whether a value is held, ready to be drawn or uploaded. */
  holds(key: string): boolean {
    return this.opened?.loader.cache.has(key) ?? false;
  }

  /** Metres from the eye of the last update to the nearest thing of the world, by its cells' bounds; null: unknown. */
  get clearance(): number | null {
    if (!this.plan || !this.viewpoint) return null;
    const { eye } = this.viewpoint;
    const { pictures, geometry } = this.plan.cut;
    let least = Infinity;
    for (const cell of [...pictures, ...geometry]) least = Math.min(least, distanceTo(cell.bounds, eye));
    return Number.isFinite(least) ? least : null;
  }

  /** Draws again at the next update even if nothing has changed. */
  invalidate(): void {
    this.planDirty = this.drawDirty = this.mustDraw = true;
  }

  /** Tries again at once what failed for want of an answer. */
  retryNow(): void {
    this.backoff.hurry();
    if (this.opened) this.opened.loader.pump();
  }

  get stats(): WorldStats {
    const cells: Record<number, number> = {};
    for (const { cell } of this.plan?.pictures ?? []) cells[cell.level] = (cells[cell.level] ?? 0) + 1;
    const { cut } = this.plan ?? {};
    return {
      splats: this.opened?.splats.count ?? 0,
      triangles: this.opened?.near.triangles ?? 0,
      tiles: this.opened?.splats.tiles ?? 0,
      cells,
      geometry_cells: this.plan?.geometry.length ?? 0,
      stand_ins: this.plan?.standIns ?? 0,
      cut_cells: cut ? cut.pictures.length + cut.geometry.length : 0,
      bytes: this.fetcher.bytes,
      requests: this.fetcher.requests,
      tiles_pending: this.pending,
      tiles_missing: this.bad,
      cache_bytes: this.opened?.loader.cache.bytes ?? 0,
      cache_budget: this.options.cacheBytes,
      coarsened: this.coarsening.levels,
    };
  }

  override dispose(): void {
    this.closing.abort();
    this.opened?.index.close();
    this.opened?.loader.clear();
    this.opened?.splats.dispose();
    this.opened?.near.dispose();
    this.opened = null;
    this.pool.dispose();
    this.frame.dispose();
  }

  /** Reads the manifest, again and again while the server does not answer. */
  private async open(): Promise<void> {
    const grown = (): void => this.changed();
    const events = { bad: (key: string, error: FarfieldError) => this.report(key, error), grown };
    for (;;) {
      try {
        const index = await WorldIndex.open(this.fetcher, this.backoff, events, this.closing.signal);
        this.backoff.succeeded();
        this.begin(index);
        return;
      } catch (thrown) {
        const error = asFarfieldError(thrown, this.fetcher.base);
        if (error.tag === "aborted") return;
        if (error.tag !== "network") {
          this.events.emit("failed", explain(error, this.fetcher.base));
          return;
        }
        this.backoff.failed(error.what);
        await this.backoff.rest();
      }
    }
  }

  private begin(index: WorldIndex): void {
    const { manifest } = index;
    const near = new NearGeometry(this.group, manifest.grid, this.light);
    const preparer = new ThreePreparer({
      manifest,
      pool: this.pool,
      shelf: new TextureShelf(this.fetcher),
      renderer: () => this.renderer!,
      forget: (model) => near.forget(model),
    });
    const loader = new Loader(this.fetcher, this.backoff, preparer, this.options.cacheBytes, {
      bad: (resource, error) => this.report(resource.key, error),
      arrived: () => this.events.emit("arrived", undefined),
    });
    this.opened = { index, loader, near, splats: new Splats(this.group, manifest.grid, this.light) };
    this.events.emit("ready", manifest);
    this.changed();
  }

  private moved(camera: Camera, size: Vector2): boolean {
    const { matrixWorld, projectionMatrix } = camera;
    const now = [matrixWorld, projectionMatrix, this.matrixWorld].flatMap(({ elements }) => elements).join() + [size.x, size.y].join();
    const moved = now !== this.lastCamera;
    this.lastCamera = now;
    return moved;
  }

  /** Makes the plan and sees to what it lacks. */
  private choose({ index, loader }: Opened, camera: Camera, renderer: WebGLRenderer, size: Vector2): void {
    this.planDirty = this.arrived = false;
    const framed = this.frame.resize(renderer, size.x, size.y, this.options.supersampling);
    const viewpoint = viewpointOf(camera, this.matrixWorld, framed.width, framed.height);
    const view = this.planView(index.manifest, viewpoint, size.x);
    const number = ++this.planNumber;
    const plan = makePlan(index.roots, index.manifest.directions, view);
    if (!this.plan || !samePlan(plan, this.plan)) this.drawDirty = true;
    this.viewpoint = viewpoint;
    this.plan = plan;
    this.fetchFor(index, loader, plan, view, number);
    const drawn = plan.pictures.flatMap(({ tiles }) => tiles);
    loader.keep([...drawn, ...plan.geometry.flatMap(({ leaf, meshes }) => [leaf, ...meshes])], number);
  }

  private draw({ splats, near }: Opened, plan: Plan, camera: Camera, renderer: WebGLRenderer): void {
    this.drawDirty = this.mustDraw = false;
    const sun = sunDirection(this.options.light);
    splats.set(plan.pictures, this.viewpoint!, sun, this.largest);
    near.set(plan.geometry, this.viewpoint!, sun);
    this.frame.draw(renderer, this.inner, camera);
  }

  private planView(manifest: Manifest, viewpoint: Viewpoint, width: number): PlanView {
    const { bias, nearRadius, farOnly, views, layers } = this.options;
    const { leafSize, resolution } = manifest.grid;
    const radius = (leafSize * width) / (2 * resolution * viewpoint.tangent);
    return {
      eye: viewpoint.eye,
      frustum: viewpoint.frustum,
      radius: radius / 2 ** (bias + this.coarsening.levels),
      near: nearRadius ?? radius,
      farOnly,
      choice: { views, layers },
    };
  }

  private fetchFor(index: WorldIndex, loader: Loader, plan: Plan, view: PlanView, number: number): void {
    index.explore([...index.roots.filter(unread), ...plan.cut.unknown]);
    const wants = listWants(index.roots, plan, index.manifest, view);
    loader.want(wants, number);
    this.seen = wants.filter(({ urgency }) => urgency <= URGENCY.seen).map(({ resource }) => resource);
    if (this.coarsening.adapt(this.seen, this.options.cacheBytes)) this.changed();
  }

  /** Fulfils what waits for a complete picture, if the one drawn last is. */
  private settle(index: WorldIndex): void {
    if (this.waiting.length === 0 || this.planDirty || this.arrived || this.drawDirty || this.pending > 0 || index.pending > 0) return;
    if (index.roots.some(unread) || this.plan!.cut.unknown.some(unread)) return;
    for (const resolve of this.waiting.splice(0)) resolve();
  }

  /** Uses this renderer from now on. */
  private meet(renderer: WebGLRenderer): void {
    if (this.renderer === renderer) return;
    this.renderer = renderer;
    const gl = renderer.getContext();
    this.largest = (gl.getParameter(gl.ALIASED_POINT_SIZE_RANGE) as Float32Array)[1] ?? 64;
    renderer.domElement.addEventListener("webglcontextrestored", () => {
      this.opened?.loader.cache.clear();
      this.invalidate();
    });
  }

  private report(key: string, error: FarfieldError): void {
    this.bad++;
    this.events.emit("bad", { key, error });
    const { roots } = this.opened!.index;
    const hopeless = roots.length > 0 && roots.every(({ views, children }) => views.size === 0 && children?.length === 0);
    if (hopeless) this.events.emit("failed", error);
    this.changed();
  }

  private changed(): void {
    this.planDirty = true;
    this.events.emit("arrived", undefined);
  }

  private applyOptions(): void {
    this.light.set(this.options.light);
    this.frame.setSky(this.options.sky);
    if (this.opened) this.opened.loader.cache.budget = this.options.cacheBytes;
    this.invalidate();
    this.changed();
  }
}

/** Whether the index of what lies at or below a cell is still to be read. */
function unread(cell: Cell): boolean {
  return cell.indexHash !== "" && cell.children === null;
}

/** Whether two plans draw the same. */
function samePlan(a: Plan, b: Plan): boolean {
  const listOf = ({ pictures, geometry }: Plan): unknown[] => [
    ...pictures.flatMap(({ tiles, holes }) => [JSON.stringify(holes), ...tiles]),
    ...geometry.flatMap(({ leaf, meshes }) => [leaf, ...meshes]),
  ];
  const [one, other] = [listOf(a), listOf(b)];
  return one.length === other.length && one.every((part, n) => part === other[n]);
}

function folderOf(url: string | URL): string {
  const address = new URL(url, globalThis.location?.href);
  address.search = address.hash = "";
  address.pathname = address.pathname.replace(/world\.json$/, "").replace(/\/?$/, "/");
  return address.href;
}

function explain(error: FarfieldError, base: string): FarfieldError {
  if (error.tag !== "missing") return error;
  return new FarfieldError("not-a-world", "no world here", base, "is this the address of a baked world?");
}

