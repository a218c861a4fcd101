import type { Camera, Group, Scene, WebGLRenderer } from "three";
import type { DecodePool } from "../core/decode/pool.js";
import type { Backoff } from "../core/backoff.js";
import { Loader, type LoaderEvents } from "../core/loader.js";
import { makePlan, samePlan, type Plan, type PlanView } from "../core/plan.js";
import type { Resource } from "../core/resource.js";
import type { Source } from "../core/source.js";
import { distanceTo } from "../core/vector.js";
import { listWants, URGENCY, type Want } from "../core/wants.js";
import type { WorldIndex } from "../core/world.js";
import { CoarseningControl } from "./coarsening.js";
import type { Frame } from "./frame.js";
import { sunDirection, type LightUniforms } from "./light.js";
import { NearGeometry } from "./near/geometry.js";
import { TextureShelf } from "./near/textures.js";
import type { WorldOptions } from "./options.js";
import { ThreePreparer } from "./preparer.js";
import { Splats } from "./splats.js";
import type { Viewpoint } from "./viewpoint.js";

/** What a session works with. */
export interface SessionParts {
  readonly index: WorldIndex;
  readonly source: Source;
  readonly backoff: Backoff;
  readonly pool: DecodePool;
  readonly light: LightUniforms;
  /** Holds what is drawn; part of `scene`. */
  readonly group: Group;
  readonly scene: Scene;
  readonly frame: Frame;
  readonly renderer: () => WebGLRenderer;
  readonly options: () => WorldOptions;
}

/** A world whose manifest has been read: plans, fetches and draws it for one viewpoint after another. */
export class Session {
  readonly loader: Loader;
  readonly splats: Splats;
  readonly near: NearGeometry;
  plan: Plan | null = null;
  private number = 0;
  private viewpoint: Viewpoint | null = null;
  /** What the picture of the last plan wants. */
  private seen: readonly Resource[] = [];
  private readonly coarsening = new CoarseningControl();

  constructor(
    private readonly parts: SessionParts,
    events: LoaderEvents,
  ) {
    const { index, source, backoff, pool, light, group, renderer, options } = parts;
    const { manifest } = index;
    this.near = new NearGeometry(group, manifest.grid, light);
    this.splats = new Splats(group, manifest.grid, light);
    const forget: NearGeometry["forget"] = (model) => this.near.forget(model);
    const preparer = new ThreePreparer({ manifest, pool, shelf: new TextureShelf(source, pool), renderer, forget });
    this.loader = new Loader(source, backoff, preparer, options().cacheBytes, events);
  }

  get index(): WorldIndex {
    return this.parts.index;
  }

  /** Levels by which the cut is coarser than asked, because the budget would not hold it. */
  get coarsened(): number {
    return this.coarsening.levels;
  }

  /** Values that the picture wants and that have not arrived. */
  get pending(): number {
    let count = 0;
    for (const { state } of this.seen) if (state !== "held" && state !== "bad") count++;
    return count;
  }

  /** Whether the last plan draws everything that its view wants. */
  get complete(): boolean {
    const { index } = this.parts;
    if (!this.plan || this.pending > 0 || index.pending > 0) return false;
    return ![...index.roots, ...this.plan.cut.unknown].some(({ unread }) => unread);
  }

  /** Whether nothing of the world can be shown: no root's index could be read. */
  get hopeless(): boolean {
    const { roots } = this.parts.index;
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

  /** Makes the plan for a picture `width` pixels wide and sees to what it lacks; returns what is different. */
  choose(viewpoint: Viewpoint, width: number): { picture: boolean; detail: boolean } {
    const { index } = this.parts;
    const before = this.plan;
    const { plan, wants, detail } = this.planWithin(viewpoint, width);
    this.viewpoint = viewpoint;
    this.plan = plan;
    this.number++;
    index.explore([...index.roots.filter(({ unread }) => unread), ...plan.cut.unknown]);
    this.loader.want(wants, this.number);
    this.loader.keep(drawnBy(plan), this.number);
    this.seen = seenOf(wants);
    return { picture: !before || !samePlan(plan, before), detail };
  }

  /** A plan whose wants fit into the budget, as far as can be told before they are fetched. */
  private planWithin(viewpoint: Viewpoint, width: number): { plan: Plan; wants: Want[]; detail: boolean } {
    const { index, options } = this.parts;
    for (;;) {
      const view = this.viewOf(viewpoint, width);
      const plan = makePlan(index.roots, index.manifest.directions, view);
      const wants = listWants(index.roots, plan, index.manifest, view);
      const change = this.coarsening.adapt(seenOf(wants), options().cacheBytes);
      if (change !== "coarser") return { plan, wants, detail: change === "finer" };
    }
  }

  /** Draws the last plan into the frame. */
  draw(camera: Camera, largestPoint: number): void {
    const { frame, scene, renderer, options } = this.parts;
    const { pictures, geometry } = this.plan!;
    const sun = sunDirection(options().light);
    this.splats.set(pictures, this.viewpoint!, sun, largestPoint);
    this.near.set(geometry, this.viewpoint!, sun);
    frame.draw(renderer(), scene, camera);
  }

  dispose(): void {
    this.parts.index.close();
    this.loader.clear();
    this.splats.dispose();
    this.near.dispose();
  }

  private viewOf(viewpoint: Viewpoint, width: number): PlanView {
    const { bias, nearRadius, farOnly, views, layers } = this.parts.options();
    const { leafSize, resolution } = this.parts.index.manifest.grid;
    const radius = (leafSize * width) / (2 * resolution * viewpoint.tangent);
    return {
      eye: viewpoint.eye,
      frustum: viewpoint.frustum,
      radius: radius / 2 ** (bias + this.coarsening.levels),
      // What is left out of a picture of the far field does not depend on the budget.
      near: (nearRadius ?? radius) / (farOnly ? 1 : 2 ** this.coarsening.levels),
      farOnly,
      choice: { views, layers },
    };
  }
}

function seenOf(wants: readonly Want[]): Resource[] {
  return wants.filter(({ urgency }) => urgency <= URGENCY.seen).map(({ resource }) => resource);
}

function drawnBy({ pictures, geometry }: Plan): Resource[] {
  return [...pictures.flatMap(({ tiles }) => tiles), ...geometry.flatMap(({ leaf, meshes }) => [leaf, ...meshes])];
}
