import type { Cell, CellGeometry } from "./cell.js";
import { ERROR_SPACING } from "./indextile.js";
import { around, type MeshForm, type PlacedMesh } from "./instances.js";
import type { Resource } from "./resource.js";
import { pictureAccuracy, toldBy } from "./stream/accuracy.js";
import { distanceTo, type Box, type Vector3 } from "./vector.js";
import { sharesOf, tilesWanted, type ViewChoice } from "./views.js";
import type { Direction } from "./manifest.js";

/** Below a cell that is shown as geometry, at most. */
const MOST_LEAVES = 256;
/** Triangles for each pixel of a view that a cell may have to be geometry from afar: they take no longer than its points. */
const TRIANGLES = 0.25;
/** The same of all instances in a cell, which are drawn while its pictures are on their way. */
const MESH_TRIANGLES = 1;
/** Leaf edges within which leaves are geometry: graphics cards hold boxes of 256 (near/leaflookup.ts). */
const REACH = 120;
/** Views that errors are told for. */
const REACHES = 3;
/** Of the diagonal of what is in a cell: what is in it is not nearer than that, on the whole, to who stands in it. */
const INSIDE = 1 / 16;

/** A cell as geometry in a form, whole or not at all: of a leaf one of its own, of others those of all leaves below together. */
export interface CellForm {
  /** 0 = full, the larger the coarser. */
  readonly level: number;
  readonly leaves: readonly CellGeometry[];
  /** What it is drawn from, each once; what refers to others comes after them. */
  readonly resources: readonly Resource[];
  /** Those of them that are meshes of which leaves below list instances: they come by themselves. */
  readonly listed: readonly Resource[];
  /** Hash and bytes of each image that it needs. */
  readonly images: ReadonlyMap<string, number>;
  /** How unlike the full geometry it looks, 0 to 1, as GeometryLevel.errors. */
  readonly told: readonly number[];
  /** Whether it has few enough triangles to be drawn from farther than near. */
  readonly far: boolean;
}

/** How what is far is looked at. */
export interface FarView {
  readonly eye: Vector3;
  /** Pixels of one unit at distance one. */
  readonly focal: number;
  readonly grid: { readonly leafSize: number; readonly resolution: number };
  /** Leaves nearer than this are geometry; 0: none are, and nothing else is. */
  readonly near: number;
  /** Whether cells farther away may be geometry, too. */
  readonly farGeometry: boolean;
  readonly choice: ViewChoice;
}

/** Instances of all leaves below a cell, and the box around them; null: there are none. */
interface Placed {
  readonly all: readonly PlacedMesh[];
  readonly byMesh: ReadonlyMap<readonly MeshForm[], readonly PlacedMesh[]>;
  readonly bounds: Box | null;
  /** See `finestAfar`. */
  finest?: number;
}

const NOTHING: Placed = { all: [], byMesh: new Map(), bounds: null, finest: Infinity };
const known = new WeakMap<Cell, readonly CellForm[]>();
const placed = new WeakMap<Cell, Placed>();

/** From fine to coarse; none of a cell with a leaf that has none, or of which not all is known yet; the twin of `CellTree.forms`. */
export function formsOf(cell: Cell, resolution: number): readonly CellForm[] {
  const found = known.get(cell);
  if (found) return found;
  const leaves = leavesBelow(cell);
  if (leaves === null) return [];
  const forms = joined(leaves, TRIANGLES * resolution ** 2);
  known.set(cell, forms);
  return forms;
}

/** Instances that have their place in a leaf below; none where there are no forms, and where not all leaves are known yet. */
export function instancesBelow(cell: Cell): readonly PlacedMesh[] {
  return placedBelow(cell).all;
}

/** The same, by the forms of their mesh: what is there of a mesh is found out once for all of them. */
export function meshesBelow(cell: Cell): ReadonlyMap<readonly MeshForm[], readonly PlacedMesh[]> {
  return placedBelow(cell).byMesh;
}

/**
 * The finest level by which instances in a cell may be drawn from farther than near, those of meshes that have no such level by their
 * coarsest; Infinity: they have too many triangles. The twin of `CellTree.finest_afar`.
 */
export function finestAfar(cell: Cell, resolution: number): number {
  const below = placedBelow(cell);
  if (below.finest !== undefined) return below.finest;
  const own = [...below.byMesh].map(([forms, placed]) => ({ forms, count: placed.reduce((sum, { instances }) => sum + instances.length, 0) }));
  const triangles = (level: number): number =>
    own.reduce((sum, { forms, count }) => sum + count * forms[Math.min(level, forms.length - 1)]!.entry.triangles, 0);
  const levels = Math.max(0, ...own.map(({ forms }) => forms.length));
  const found = Array.from({ length: levels }, (_, level) => level).find((level) => triangles(level) <= MESH_TRIANGLES * resolution ** 2);
  return (below.finest = found ?? Infinity);
}

/** The box around all of them, local metres; null: there are none. */
export function boundsOfInstances(cell: Cell): Box | null {
  return placedBelow(cell).bounds;
}

function placedBelow(cell: Cell): Placed {
  const found = placed.get(cell);
  if (found) return found;
  const leaves = leavesBelow(cell);
  if (leaves === null) return NOTHING;
  const all = leaves.flatMap(({ instances }) => instances);
  const below = all.length === 0 ? NOTHING : { all, byMesh: groupedByMesh(all), bounds: around(all.map(({ bounds }) => bounds)) };
  placed.set(cell, below);
  return below;
}

function groupedByMesh(all: readonly PlacedMesh[]): Map<readonly MeshForm[], PlacedMesh[]> {
  const groups = new Map<readonly MeshForm[], PlacedMesh[]>();
  for (const one of all) {
    const group = groups.get(one.forms);
    if (group) group.push(one);
    else groups.set(one.forms, [one]);
  }
  return groups;
}

/** Metres that a pixel is wide on what is in a cell. */
export function pixelWidth(bounds: Box, away: number, focal: number): number {
  const { lower, upper } = bounds;
  const diagonal = Math.hypot(upper[0] - lower[0], upper[1] - lower[1], upper[2] - lower[2]);
  return Math.max(away, INSIDE * diagonal + 1e-9) / focal;
}

/** Whether what is so far away may be geometry. */
export function isWithinReach(away: number, leafSize: number): boolean {
  return away < REACH * leafSize;
}

/**
 * How unlike the full geometry a form looks where a pixel is `width` metres wide: 0 = like it, 1 = as nothing. farthest: pixels of a
 * leaf's pictures that one is wide in the first view that errors are told for; of a form of a mesh MESH_FARTHEST.
 */
export function errorAt({ told }: Pick<CellForm, "told">, pitch: number, width: number, farthest = 1): number {
  const at = Math.min(Math.max(Math.log((farthest * pitch) / Math.max(width, 1e-9)) / Math.log(ERROR_SPACING), 0), REACHES - 1);
  const below = Math.min(Math.floor(at), REACHES - 2);
  return told[below]! + (told[below + 1]! - told[below]!) * (at - below);
}

/** The finest form that is held, where it shows a cell farther away than near at least as well as pictures, held so far, do. */
export function heldForm(cell: Cell, view: FarView, pictures: number): CellForm | null {
  const { near, farGeometry, focal, grid } = view;
  const away = distanceTo(cell.bounds, view.eye);
  if (near <= 0 || !farGeometry || !isWithinReach(away, grid.leafSize)) return null;
  const form = formsOf(cell, grid.resolution).find(({ far, resources }) => far && resources.every(({ held }) => held));
  if (!form) return null;
  const pitch = grid.leafSize / grid.resolution;
  const width = pixelWidth(cell.bounds, away, focal);
  const error = errorAt(form, pitch, width);
  return 1 - error >= pictures * pictureAccuracy(cell.told, (pitch * 2 ** cell.level) / width) ? form : null;
}

/** How much of what a cell's pictures show is held. */
export function heldShare(cell: Cell, view: FarView, directions: ReadonlyMap<number, Direction>): number {
  const wanted = tilesWanted(cell, directions, view.eye, view.choice);
  const shares = sharesOf(cell, wanted, view.eye);
  return wanted.reduce((sum, { held }, n) => sum + (held ? shares[n]! : 0), 0);
}

/** The leaves below; none when one of them has no geometry, or there are too many; null: not all are known. */
function leavesBelow(cell: Cell): Cell[] | null {
  const found: Cell[] = [];
  const waiting = [cell];
  for (let own = waiting.pop(); own; own = waiting.pop()) {
    if (own.level > 0 && own.children === null) return null;
    if (own.children?.length) waiting.push(...[...own.children].reverse());
    else if (own.geometry && found.length < MOST_LEAVES) found.push(own);
    else if (own.views.size > 0) return [];
  }
  return found;
}

function joined(leaves: readonly Cell[], mostTriangles: number): CellForm[] {
  const count = Math.max(0, ...leaves.map(({ forms }) => forms.length));
  const listed = new Set(leaves.flatMap(({ instances }) => instances.flatMap(({ forms }) => forms.map(({ mesh }) => mesh))));
  return Array.from({ length: count }, (_, level) => {
    const own = leaves.map(({ forms }) => forms[Math.min(level, forms.length - 1)]!);
    const told = own.map(({ entry: { errors } }) => (errors?.length ? toldBy(errors) : [0, 0, 0]));
    const drawn = own.map(({ entry }) => entry.drawn || (entry.instances > 0 ? 0 : entry.triangles));
    const resources = [...new Set(own.flatMap(({ leaf, meshes }) => [...meshes, leaf]))];
    return {
      level,
      leaves: own,
      resources,
      listed: resources.filter((resource) => listed.has(resource)),
      images: new Map(own.flatMap(({ entry }) => entry.textures ?? [])),
      told: Array.from({ length: REACHES }, (_, n) => told.reduce((sum, one) => sum + one[n]!, 0) / told.length),
      far: drawn.every((triangles) => triangles > 0) && drawn.reduce((sum, one) => sum + one, 0) <= mostTriangles,
    };
  });
}
