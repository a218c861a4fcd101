import type { WebGLRenderer } from "three";
import { AttributeTables, type Attributes } from "../core/attributes.js";
import { FarfieldError } from "../core/errors.js";
import { formatKey, type Grid } from "../core/grid.js";
import type { Manifest } from "../core/manifest.js";
import { candidatesAt, type DrawnBy } from "../core/picking/candidates.js";
import { CellObjects } from "../core/picking/objects.js";
import { pointOf, rayThrough, type Ray } from "../core/picking/ray.js";
import type { Plan } from "../core/plan.js";
import type { Servers } from "../core/servers.js";
import type { Vector3 } from "../core/vector.js";
import type { Frame } from "./frame.js";
import { geometryHit } from "./near/hits.js";
import type { Viewpoint } from "./viewpoint.js";

/** What is at a place of a picture. */
export interface Picked {
  /** The object's; null: it is none, or the world was baked without ids. */
  readonly id: number | null;
  /** Those of the object. */
  readonly attributes: Attributes;
  /** Local metres. */
  readonly position: Vector3;
  /** The cell that shows it, "level/x/y/z". */
  readonly cell: string;
  /** What it is drawn by. */
  readonly by: DrawnBy;
}

/** A picture that was drawn. */
export interface DrawnPicture {
  readonly plan: Plan;
  readonly viewpoint: Viewpoint;
  /** Of the generation that it shows. */
  readonly manifest: Manifest;
}

type Shown = Pick<Picked, "id" | "cell" | "by">;

/** Tells what is at a place of the picture that was drawn last. */
export class Picker {
  private readonly objects: CellObjects;
  private readonly attributes: AttributeTables;

  constructor(
    servers: Servers,
    manifest: Manifest,
    private readonly frame: Frame,
  ) {
    this.objects = new CellObjects(servers, manifest);
    this.attributes = new AttributeTables(servers);
  }

  /** What is at pixel (x, y) from the upper left; null: nothing is drawn there. Rejects with `network`, `missing`, `corrupt` or `aborted`. */
  async pick({ plan, viewpoint, manifest }: DrawnPicture, renderer: WebGLRenderer, x: number, y: number, signal: AbortSignal): Promise<Picked | null> {
    const sample = await this.frame.nearestIn(renderer, x, y);
    if (signal.aborted) throw new FarfieldError("aborted", "no longer wanted");
    if (!sample) return null;
    const ray = rayThrough(viewpoint, sample.x, sample.y);
    const distance = viewpoint.near / sample.depth;
    const shown = await this.shownAt(plan, manifest.grid, ray, distance, signal);
    if (!shown) return null;
    const attributes = shown.id === null ? {} : await this.attributes.of(shown.id, manifest.attributes, signal);
    return { ...shown, attributes, position: pointOf(ray, distance) };
  }

  private async shownAt(plan: Plan, grid: Grid, ray: Ray, distance: number, signal: AbortSignal): Promise<Shown | null> {
    const hit = geometryHit(plan, grid, ray, distance);
    if (hit) return { id: hit.id || null, cell: leafAt(grid, hit.corner), by: "geometry" };
    const candidates = candidatesAt(plan, grid, ray, distance);
    for (const candidate of candidates) {
      const id = await this.objects.at(candidate, ray, signal);
      if (id !== null) return { id: id || null, cell: candidate.cell.name, by: candidate.by };
    }
    const [first] = candidates;
    return first ? { id: null, cell: first.cell.name, by: first.by } : null;
  }
}

/** Name of the leaf with that lower corner. */
function leafAt({ corner, leafSize }: Grid, lower: Vector3): string {
  const [x, y, z] = [0, 1, 2].map((a) => Math.round((lower[a]! - corner[a]!) / leafSize)) as [number, number, number];
  return formatKey({ level: 0, x, y, z });
}
