import type { Camera, Group, Scene, WebGLRenderer } from "three";
import { joinWants, LookAhead } from "../core/ahead.js";
import type { DecodePool } from "../core/decode/pool.js";
import { Loader, type LoaderEvents } from "../core/loader.js";
import type { Cell } from "../core/cell.js";
import { Culler } from "../core/culling.js";
import type { DepthPyramid } from "../core/depthpyramid.js";
import { seesBox } from "../core/frustum.js";
import { makePlan, samePlan, type Plan, type PlanView } from "../core/plan.js";
import type { Manifest } from "../core/manifest.js";
import { PushClient } from "../core/push/client.js";
import type { ViewMessage } from "../core/push/messages.js";
import type { Resource } from "../core/resource.js";
import type { Server, Servers } from "../core/servers.js";
import { shownBy, type Shown } from "../core/shown.js";
import { distanceTo, farthestIn, type Vector3 } from "../core/vector.js";
import type { Viewing } from "../core/stream/motion.js";
import { Observer } from "../core/stream/observer.js";
import { Ranking } from "../core/stream/ranking.js";
import { coarseFirst, isNeeded, listWants, URGENCY, type Want } from "../core/wants.js";
import type { WorldIndex } from "../core/world.js";
import { anisotropyOf } from "./card.js";
import { BlockMaps, type BlockMapDraw, type BlockMapHandle } from "./blockmaps.js";
import { CoarseningControl } from "./coarsening.js";
import { DepthReader } from "./depthreader.js";
import { renderInto, type Frame } from "./frame.js";
import { sunDirection, type LightUniforms } from "./light.js";
import { expectGeometry } from "./near/draco.js";
import { NearGeometry } from "./near/geometry.js";
import { TextureShelf } from "./near/textures.js";
import type { WorldOptions } from "./options.js";
import type { DrawnPicture } from "./picker.js";
import { ThreePreparer } from "./preparer.js";
import type { Shadows } from "./shadows.js";
import { Splats, type SplatView } from "./splats.js";
import type { Viewpoint } from "./viewpoint.js";

/** Milliseconds for which a new generation waits to be complete once the view moves: a flight may never rest. */
const PATIENCE_MS = 3000;
/** After which an eye that has not moved rests, for certain (Observer). */
const REST_MS = 600;
/** Milliseconds for which shadows stay as they are while things come in. */
const SHADOWS_MS = 4000;

/** Milliseconds without a complete picture after which what can stand in comes first: the link is slower than the flight. */
const BEHIND_MS = 2000;
/** Share of the cache up to which that is done: then it and the picture fit together. */
const ROOM_TO_STAND_IN = 0.7;

/** Seconds of the link that index tiles under way may take. */
const INDEX_SECONDS = 0.25;

/** What a session works with. */
export interface SessionParts {
  readonly index: WorldIndex;
  readonly servers: Servers;
  readonly pool: DecodePool;
  readonly light: LightUniforms;
  /** Holds what is drawn; part of `scene`. */
  readonly group: Group;
  readonly scene: Scene;
  readonly frame: Frame;
  readonly shadows: Shadows;
  readonly renderer: () => WebGLRenderer;
  readonly options: () => WorldOptions;
}

export interface SessionEvents extends LoaderEvents {
  /** The server shows another generation. */
  readonly outdated: () => void;
  /** The last picture lacks something that was held to be hidden. */
  readonly lacking: () => void;
}

/** A world whose manifest has been read: plans, fetches and draws it for one viewpoint after another. */
export class Session {
  readonly loader: Loader;
  readonly splats: Splats;
  readonly near: NearGeometry;
  readonly blockmaps: BlockMaps;
  readonly preparer: ThreePreparer;
  private readonly shelf: TextureShelf;
  /** Null: the world is split over servers, none of which could decide alone. */
  readonly push: PushClient | null;
  plan: Plan | null = null;
  /** Of the generation that is shown. */
  index: WorldIndex;
  /** Of a newer one, whose tiles for the view are on their way. */
  next: WorldIndex | null = null;
  private movedAt: number | null = null;
  private number = 0;
  private resting: ReturnType<typeof setTimeout> | undefined;
  private viewpoint: Viewpoint | null = null;
  private view: PlanView | null = null;
  private ahead = new LookAhead();
  private readonly observer = new Observer();
  private ranking: Ranking;
  private lastShown: Shown | null = null;
  /** Since when there has been no complete picture. */
  private lackingSince: number | null = null;
  /** What the picture of the last plan wants. */
  private seen: readonly Resource[] = [];
  private readonly coarsening: CoarseningControl;
  /** What the shadow maps show, and how often that has changed. */
  private casters: { readonly plan: Plan | null; readonly number: number } = { plan: null, number: 0 };
  private castersAt = -Infinity;
  private castersDoubtful = false;
  private readonly reader = new DepthReader((pyramid) => this.hasRead(pyramid));
  /** How far one saw in the newest picture that has been read. */
  private before: DepthPyramid | null = null;
  /** Of the picture that was drawn last. */
  drawn: Viewpoint | null = null;
  /** What that shows, and of which generation. */
  picture: DrawnPicture | null = null;
  /** The picture that was drawn last, while it is not certain that nothing is missing from it. */
  private unsure: Culler | null = null;

  constructor(
    private readonly parts: SessionParts,
    private readonly events: SessionEvents,
  ) {
    const { index, servers, pool, light, group, renderer, options } = parts;
    this.index = index;
    const { manifest } = index;
    this.near = new NearGeometry(group, manifest.grid, light);
    this.blockmaps = new BlockMaps(group, manifest.grid, light);
    this.splats = new Splats(group, manifest.grid, light);
    const forget: NearGeometry["forget"] = (model) => this.near.forget(model);
    this.shelf = new TextureShelf(servers, pool, () => anisotropyOf(renderer()));
    const { blockmaps, shelf } = this;
    this.preparer = new ThreePreparer({ manifest, pool, shelf, renderer, blockmaps, forget, patches: () => options().patches });
    const { nearRadius, farOnly, farGeometry } = options();
    if (nearRadius !== 0 && (farGeometry || !farOnly)) expectGeometry();
    this.loader = new Loader(servers, this.preparer, options().cacheBytes, events);
    this.coarsening = new CoarseningControl(this.loader.sizes);
    this.ranking = new Ranking(this.loader.link, this.loader.sizes);
    this.push = manifest.servers ? null : this.pushFrom(servers.all[0]!);
    this.loader.push = this.push;
  }

  private pushFrom(server: Server): PushClient {
    return new PushClient({
      server,
      loader: this.loader,
      find: (key) => this.next?.find(key) ?? this.index.find(key),
      images: this.shelf,
      generation: () => this.newest.generation,
      token: () => this.parts.options().token,
      outdated: this.events.outdated,
    });
  }

  /** Prepares a newer generation; it takes the place of the present one when all that the view wants of it is there. */
  follow(manifest: Manifest): void {
    this.next?.close();
    this.next = this.index.followedBy(manifest);
    this.movedAt = null;
    this.push?.renew();
  }

  /** Manifest of the newest generation that is known. */
  get newest(): Manifest {
    return (this.next ?? this.index).manifest;
  }

  /** The view has changed. */
  moved(): void {
    this.movedAt ??= performance.now();
  }

  /** Whether a value belongs to the newest generation, and not only to one that is to be replaced. */
  isNewest({ cell }: Resource): boolean {
    return !this.next || cell === null || this.next.roots.includes(cell.root);
  }

  /** Bytes and requests since the session began. */
  get traffic(): { readonly bytes: number; readonly requests: number } {
    const { bytes, requests } = this.parts.servers;
    return { bytes: bytes + (this.push?.bytes ?? 0), requests };
  }

  /** Levels by which the cut is coarser than asked, because the budget would not hold it. */
  get coarsened(): number {
    return this.coarsening.levels;
  }

  /** Values that the picture wants and that have not arrived. */
  get pending(): number {
    const lacks = this.parts.servers.lacking();
    let count = 0;
    for (const resource of this.seen) if (!isDone(resource, lacks)) count++;
    return count;
  }

  /** Whether the last plan draws everything that its view wants. */
  get complete(): boolean {
    return !!this.plan && !this.next && !this.unsure && this.pending === 0 && isKnown(this.index, this.plan);
  }

  /** Whether nothing of the world can be shown: no root's index could be read. */
  get hopeless(): boolean {
    const { roots } = this.index;
    return roots.length > 0 && roots.every(({ views, children }) => views.size === 0 && children?.length === 0);
  }

  /** Metres from the eye to the nearest thing, by the bounds of the cells; null: unknown. */
  get clearance(): number | null {
    if (!this.plan || !this.viewpoint) return null;
    let least = Infinity;
    const { pictures, geometry } = this.plan.cut;
    for (const { bounds } of [...pictures, ...geometry]) least = Math.min(least, distanceTo(bounds, this.viewpoint.eye));
    return Number.isFinite(least) ? least : null;
  }

  /** How much of what was planned last is not as it should be; found out when it is asked for. */
  get shown(): Shown | null {
    if (this.plan && !this.lastShown) this.lastShown = shownBy(this.plan, this.view!, this.viewpoint!);
    return this.lastShown;
  }

  /** Values and index tiles asked for that have not come. */
  get underWay(): number {
    return this.loader.asked + this.index.pending;
  }

  /** Makes the plan for a picture `width` pixels wide and sees to what it lacks; returns what is different. */
  choose(viewpoint: Viewpoint, width: number): { picture: boolean; detail: boolean; generation: boolean } {
    const before = this.plan;
    const next = this.prepareNext(viewpoint, width);
    const { index } = this;
    const { plan, view, wants, detail } = this.planWithin(viewpoint, width);
    this.viewpoint = viewpoint;
    this.plan = plan;
    this.view = view;
    this.lastShown = null;
    this.castersDoubtful = true;
    this.number++;
    this.seen = seenOf(wants);
    const soon = this.lookAhead(plan, view);
    const viewing = this.watch(viewpoint, width);
    const all = joined(next.wants ?? [], joinWants([this.ordered(wants, viewing, view), soon]));
    const { benefit } = this.parts.options();
    // Who moves on has no use for what the cut needs nothing of by the time it is there.
    this.explore(index, plan, view, [...this.ahead.unknown, ...(benefit && isAtRest(viewing) ? this.ranking.unknown : [])]);
    this.loader.isLearning = benefit && plan.cut.unknown.some(({ reach }) => seesBox(view.frustum, reach));
    this.loader.want(all, this.number, drawnBy(plan), this.next !== null);
    this.push?.settle(all);
    if (!isAtRest(viewing)) this.lookAgain();
    // Last: what the loader asks for now the server knows of by then.
    this.push?.see(this.told(viewing, view));
    if (next.taken) this.loader.cache.dropGone();
    const picture = !before || !samePlan(plan, before);
    // A picture that is complete has its own shadows at once.
    if (picture && this.pending === 0) this.castersAt = -Infinity;
    return { picture, detail, generation: next.taken };
  }

  /** Reads the index that a plan lacks, what is in the picture and largest there first, and then that below other cells. */
  private explore(index: WorldIndex, { cut }: Plan, { eye, frustum }: PlanView, others: readonly Cell[] = []): void {
    const unknown = cut.unknown.map((cell) => ({
      cell,
      isSeen: seesBox(frustum, cell.reach),
      size: 2 ** cell.level / Math.max(distanceTo(cell.reach, eye), 1),
    }));
    unknown.sort((a, b) => Number(b.isSeen) - Number(a.isSeen) || b.size - a.size);
    const cells = [...index.roots.filter(({ unread }) => unread), ...unknown.map(({ cell }) => cell), ...others];
    index.explore(cells, this.loader.link.bandwidth * INDEX_SECONDS);
  }

  /** More of the index is known. */
  grown(): void {
    this.ranking.forget();
  }

  /** Plans once more when the eye rests, if nothing else does: who stands has use for other things. */
  private lookAgain(): void {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.events.unforeseen?.(), REST_MS);
  }

  /** Wants in the order in which they are to be fetched. */
  private ordered(wants: Want[], viewing: Viewing, view: PlanView): Want[] {
    const { options, servers } = this.parts;
    if (!options().benefit) return this.inTime(wants, view);
    const { manifest, roots } = this.index;
    const cells = { ...view, roots, directions: manifest.directions, holdsImage: (hash: string) => this.shelf.holds(hash), lacks: servers.lacking() };
    return this.ranking.rank(wants, cells, viewing, options().cacheBytes);
  }

  /** How the eye moves that sees a picture `width` pixels wide. */
  private watch(viewpoint: Viewpoint, width: number): Viewing {
    const share = width / viewpoint.width;
    const shown = { ...viewpoint, focal: viewpoint.focal * share, width, height: viewpoint.height * share };
    return this.observer.see(shown, performance.now() / 1000, this.index.manifest.grid.leafSize);
  }

  /** What a server has to know of a view to send what it is drawn from. */
  private told({ eye, forward, focal, size, velocity, acceleration, turning }: Viewing, { radius, near, farGeometry, choice }: PlanView): ViewMessage {
    const [width, height] = size.map((pixels) => clamped(Math.round(pixels), 1, 16384)) as [number, number];
    return {
      eye, forward, velocity, acceleration, turning,
      size: [width, height],
      fov: clamped((360 / Math.PI) * Math.atan(height / 2 / focal), 0.1, 179),
      nearRadius: near,
      // The server's radius is focal times pitch, and halved by each 1 of it.
      bias: clamped(Math.log2((focal * this.index.manifest.grid.pitch(0)) / radius), -4, 8),
      leastGain: choice.leastGain,
      farGeometry,
      dynamicImpostors: true,
    };
  }

  /** Wants in their order, or, where the link has been too slow for a while, with what can stand in first. */
  private inTime(wants: Want[], view: PlanView): Want[] {
    if (this.pending === 0) this.lackingSince = null;
    else this.lackingSince ??= performance.now();
    if (this.lackingSince === null || performance.now() - this.lackingSince < BEHIND_MS) return wants;
    const soonest = wants.filter(({ urgency }) => urgency <= URGENCY.cover);
    const bytes = soonest.reduce((sum, { resource }) => sum + this.loader.sizes.of(resource), 0);
    return bytes > this.parts.options().cacheBytes * ROOM_TO_STAND_IN ? wants : coarseFirst(wants, view.frustum);
  }

  /** What the picture will want as the eye moves on. */
  private lookAhead(plan: Plan, view: PlanView): readonly Want[] {
    const { manifest, roots } = this.index;
    const { pictures, geometry } = plan.cut;
    const finest = [...pictures, ...geometry].reduce((least, { level }) => Math.min(least, level), Infinity);
    const cell = manifest.grid.leafSize * 2 ** finest;
    this.ahead.follow(view.eye, performance.now() / 1000, cell, this.parts.options().ahead);
    return this.ahead.look({ roots, manifest, lacks: this.parts.servers.lacking() }, view);
  }

  /**
   * What the view wants of the generation to come, ahead of everything else; or, when that is all there, takes it in the
   * place of the present one.
   */
  private prepareNext(viewpoint: Viewpoint, width: number): { taken: boolean; wants: readonly Want[] | null } {
    const { next } = this;
    if (!next) return { taken: false, wants: null };
    const view = this.viewOf(viewpoint, width);
    const plan = makePlan(next.roots, next.manifest.directions, view);
    const lacks = this.parts.servers.lacking();
    const wants = listWants(next.roots, plan, next.manifest, view, lacks).filter(({ urgency }) => isNeeded(urgency));
    const there = isKnown(next, plan) && wants.every(({ resource }) => isDone(resource, lacks));
    if (!there && !this.isOverdue(wants)) {
      this.explore(next, plan, view);
      return { taken: false, wants };
    }
    this.index.close();
    this.index = next;
    this.ahead = new LookAhead();
    this.ranking = new Ranking(this.loader.link, this.loader.sizes);
    this.next = this.movedAt = null;
    return { taken: true, wants: null };
  }

  /** Whether waiting has no end, and the roots at least can stand in for what is missing. */
  private isOverdue(wants: readonly Want[]): boolean {
    if (this.movedAt === null || performance.now() < this.movedAt + PATIENCE_MS) return false;
    const roots = wants.filter(({ urgency }) => urgency === URGENCY.root);
    const lacks = this.parts.servers.lacking();
    return roots.length > 0 && roots.every(({ resource }) => isDone(resource, lacks));
  }

  /** A plan whose wants fit into the budget, as far as can be told before they are fetched. */
  private planWithin(viewpoint: Viewpoint, width: number): { plan: Plan; view: PlanView; wants: Want[]; detail: boolean } {
    const { index } = this;
    const { options, servers } = this.parts;
    const lacks = servers.lacking();
    for (;;) {
      const view = this.viewOf(viewpoint, width);
      const plan = makePlan(index.roots, index.manifest.directions, view);
      const wants = listWants(index.roots, plan, index.manifest, view, lacks);
      const change = this.coarsening.adapt(seenOf(wants), options().cacheBytes);
      if (change !== "coarser") return { plan, view, wants, detail: change === "finer" };
    }
  }

  /** Draws the last plan into the frame; `width`: of the picture, pixels. */
  draw(camera: Camera, largestPoint: number, width: number): void {
    const { frame, scene, renderer, options } = this.parts;
    const { light, culling } = options();
    const [viewpoint, sun] = [this.viewpoint!, sunDirection(light)];
    this.drawShadows(camera, largestPoint, width, sun);
    const culler = new Culler(viewpoint, culling, this.before);
    this.place(this.plan!, { viewpoint, sun, largest: largestPoint, culler, bothSides: false });
    frame.draw(renderer(), scene, camera);
    this.drawn = viewpoint;
    this.picture = { plan: this.plan!, viewpoint, manifest: this.index.manifest };
    this.unsure = culler.isGuess ? culler : null;
    if (culling === "all") this.reader.read(renderer(), frame.depth, viewpoint);
  }

  /** The graphics card has lost what it held. */
  lost(): void {
    this.loader.cache.clear();
    this.reader.clear();
    this.parts.frame.forget();
    this.before = null;
  }

  /** Takes how far one saw in a picture: the next is drawn by it, and what the last one lacks is drawn at once. */
  private hasRead(pyramid: DepthPyramid): void {
    this.before = pyramid;
    if (pyramid.view !== this.unsure?.view) return;
    if (!this.unsure.isRight(pyramid)) return this.events.lacking();
    this.unsure = null;
    this.events.arrived();
  }

  private place({ pictures, geometry, solids, instances }: Plan, view: SplatView): void {
    this.splats.set(pictures.filter((draw) => !isMap(draw.tiles[0]!)), view);
    const { farOnly, near } = this.view!;
    const merged = solids.filter(({ form }) => !isMap(form.leaf));
    this.near.set({ leaves: geometry, solids: merged, instances, leftOut: farOnly ? near : 0 }, view.viewpoint, view.sun);
    this.blockmaps.set(mapsOf(pictures, solids), view);
  }

  /** Whether shadows are to be drawn anew for what has come since, in the picture or not. */
  get shadowsDue(): boolean {
    return this.parts.options().shadows && this.castersDoubtful && this.castersMayChange;
  }

  /** Shadow maps take as long as pictures: while things come in, what has come is gathered for a while. */
  private get castersMayChange(): boolean {
    return this.loader.underWay === 0 || performance.now() > this.castersAt + SHADOWS_MS;
  }

  /** Brings the shadows up to date: what casts them is the same cut on all sides, as far as it is held. */
  private drawShadows(camera: Camera, largest: number, width: number, sun: Vector3): void {
    const { shadows, scene, renderer, options } = this.parts;
    if (!options().shadows || sun[2] <= 0) return shadows.clear();
    const { eye } = this.viewpoint!;
    const { roots, manifest } = this.index;
    const plan = makePlan(roots, manifest.directions, { ...this.viewOf(this.viewpoint!, width), frustum: [] });
    this.takeCasters(plan);
    const farthest = roots.reduce((most, { bounds }) => Math.max(most, farthestIn(bounds, eye)), 0);
    const view = { eye, sun, casters: this.casters.number, nearest: this.clearance ?? 0, farthest };
    shadows.update(renderer(), view, (viewpoint, target) => {
      this.place(plan, { viewpoint, sun, largest, culler: new Culler(viewpoint, "frustum", null), bothSides: true });
      renderInto(target, renderer(), scene, camera);
    });
  }

  private takeCasters(plan: Plan): void {
    if (!this.castersMayChange) return;
    this.castersDoubtful = false;
    this.castersAt = performance.now();
    const { plan: before, number } = this.casters;
    if (!before || !samePlan(plan, before)) this.casters = { plan, number: number + 1 };
  }

  dispose(): void {
    clearTimeout(this.resting);
    this.push?.close();
    this.next?.close();
    this.index.close();
    this.parts.servers.close();
    this.loader.clear();
    this.splats.dispose();
    this.near.dispose();
    this.blockmaps.dispose();
    this.reader.dispose();
  }

  private viewOf(viewpoint: Viewpoint, width: number): PlanView {
    const { bias, nearRadius, farOnly, farGeometry, benefit, views, leastGain, layers } = this.parts.options();
    const { grid, near } = this.index.manifest;
    const { leafSize, resolution } = grid;
    const radius = (leafSize * width) / (2 * resolution * viewpoint.tangent);
    return {
      eye: viewpoint.eye,
      frustum: viewpoint.frustum,
      radius: radius / 2 ** (bias + this.coarsening.levels),
      // What is left out of a picture of the far field does not depend on the budget.
      near: (nearRadius ?? near * radius) / (farOnly ? 1 : 2 ** this.coarsening.levels),
      farOnly,
      focal: viewpoint.focal * (width / viewpoint.width),
      grid,
      // What is nearest first asks for pictures.
      farGeometry: farGeometry && benefit,
      choice: { views, leastGain, layers },
    };
  }
}

function isMap({ kind }: Resource): boolean {
  return kind === "blockmap";
}

/** What of a plan is drawn by casting rays: in place of pictures, and of merged geometry. */
function mapsOf(pictures: Plan["pictures"], solids: Plan["solids"]): BlockMapDraw[] {
  const asPictures = pictures.map(({ cell, tiles, holes, behind }) => ({ cell, tile: tiles[0]!, holes, behind }));
  const asSolids = solids.map(({ cell, form, holes, behind }) => ({ cell, tile: form.leaf, holes, behind }));
  const maps = [...asPictures, ...asSolids].filter(({ tile }) => isMap(tile));
  return maps.map(({ cell, tile, holes, behind }) => ({ cell, handle: tile.payload as BlockMapHandle, holes, behind }));
}

/** Whether nothing more is to be expected of a value, for now. */
function isDone(resource: Resource, lacks: (resource: Resource) => boolean): boolean {
  return resource.held || lacks(resource);
}

/** Whether the index has been read as far as a plan needs it. */
function isKnown(index: WorldIndex, plan: Plan): boolean {
  return index.pending === 0 && ![...index.roots, ...plan.cut.unknown].some((cell) => index.isDue(cell));
}

/** Both lists, each value once. */
function joined(first: readonly Want[], second: readonly Want[]): readonly Want[] {
  if (first.length === 0) return second;
  const known = new Set(first.map(({ resource }) => resource));
  return [...first, ...second.filter(({ resource }) => !known.has(resource))];
}

function isAtRest({ velocity, turning }: Viewing): boolean {
  return turning === 0 && velocity.every((along) => along === 0);
}

function clamped(value: number, least: number, most: number): number {
  return Math.min(most, Math.max(least, value));
}

function seenOf(wants: readonly Want[]): Resource[] {
  return wants.filter(({ urgency }) => isNeeded(urgency)).map(({ resource }) => resource);
}

function drawnBy({ pictures, geometry, solids, instances }: Plan): Resource[] {
  const near = [...geometry.flatMap(({ leaf, meshes }) => [leaf, ...meshes]), ...solids.map(({ form }) => form.leaf)];
  return [...pictures.flatMap(({ tiles }) => tiles), ...near, ...instances.map(({ form }) => form.mesh)];
}
