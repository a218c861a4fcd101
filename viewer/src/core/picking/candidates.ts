import type { Cell } from "../cell.js";
import type { Grid } from "../grid.js";
import type { Plan } from "../plan.js";
import type { Resource } from "../resource.js";
import { distanceTo } from "../vector.js";
import { pointOf, type Ray } from "./ray.js";

/** What something is drawn by. */
export type DrawnBy = "geometry" | "orthoview" | "blockmap";

/** A cell that may show what is at a point. */
export interface Candidate {
  readonly cell: Cell;
  readonly by: DrawnBy;
  /** What it is drawn from. */
  readonly drawn: readonly Resource[];
  /** The distance, along the view axis, of the point as the cell has it: where it goes behind finer cells, the picture shows it farther away. */
  readonly distance: number;
}

/** A splat reaches at most this many pitches from its middle, which is in its cell. */
const SPLAT_REACH = 4;
/** Parts of a pitch by which a point is moved along the ray, into what is seen: what stands on the border of two cells is then in one. */
const INWARD = 32;

/**
 * Cells of a plan that may show what a ray meets at a distance along the view axis: those that hold the point, and then those that reach
 * there, each from fine to coarse, as a finer one leaves the coarser nothing to show.
 * Leaves that are drawn as geometry, and instances, are not among them: their triangles tell for themselves.
 */
export function candidatesAt({ pictures, solids }: Pick<Plan, "pictures" | "solids">, grid: Grid, ray: Ray, distance: number): Candidate[] {
  const all = [
    ...pictures.map(({ cell, tiles, behind }) => ({ cell, drawn: tiles, behind })),
    ...solids.map(({ cell, form, behind }) => ({ cell, drawn: [form.leaf], behind })),
  ];
  const found: { readonly candidate: Candidate; readonly away: number }[] = [];
  for (const { cell, drawn, behind } of all) {
    const pitch = grid.pitch(cell.level);
    const own = behind ? distance - pitch : distance;
    const away = distanceTo(cell.box, pointOf(ray, own, pitch / INWARD));
    if (away <= SPLAT_REACH * pitch) found.push({ away: Math.sign(away), candidate: { cell, by: kindOf(drawn[0]!), drawn, distance: own } });
  }
  found.sort((a, b) => a.away - b.away || a.candidate.cell.level - b.candidate.cell.level);
  return found.map(({ candidate }) => candidate);
}

function kindOf({ kind }: Resource): DrawnBy {
  return kind === "orthoview" || kind === "blockmap" ? kind : "geometry";
}
