import type { Cell, CellGeometry } from "./cell.js";
import { ERROR_SPACING } from "./indextile.js";
import { around, type MeshForm, type PlacedMesh } from "./instances.js";
import type { Resource } from "./resource.js";
import { pictureAccuracy, toldBy } from "./stream/accuracy.js";
import type { Box } from "./vector.js";

/** Below a cell that is shown as geometry, at most. */
const MOST_LEAVES = 256;
/** Triangles for each pixel of a view that the leaves below a cell may have to be geometry from afar: they take no longer than its points. */
const TRIANGLES = 1.5;
/** The same of all instances in a cell, which are drawn while its pictures are on their way. */
const MESH_TRIANGLES = 1;
/** Number of the finest form of a cell's own, beyond those of any leaf. */
const FIRST_OWN = 32;
/** Leaf edges within which leaves are geometry: graphics cards hold boxes of 256 (near/leaflookup.ts). */
const REACH = 120;
/** Views that errors are told for. */
const REACHES = 3;
/** Of the diagonal of what is in a cell: what is in it is not nearer than that, on the whole, to who stands in it. */
const INSIDE = 1 / 16;

/** A cell as geometry in a form, whole or not at all: those of all leaves at or below it together, or, above the leaves, one of its own. */
export interface CellForm {
  /** 0 = full, the larger the coarser; of a cell above the leaves itself from FIRST_OWN on. */
  readonly level: number;
  /** What is drawn: of leaves or, alone, of the cell above them. */
  readonly leaves: readonly CellGeometry[];
  /** Whether it is the cell's own: of one above the leaves, which shows all below but for the instances that are listed there; or a BlockMap. */
  readonly own: boolean;
  /** Whether it is a BlockMap, which shows instances, too. */
  readonly isMap: boolean;
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
/** Cells below which all leaves are known: that does not change. */
const whole = new WeakSet<Cell>();

/**
 * Those of the leaves from fine to coarse, none where a leaf has none or not all are known yet, then the cell's own; the twin of
 * `CellTree.forms`.
 */
export function formsOf(cell: Cell, resolution: number): readonly CellForm[] {
  const found = known.get(cell);
  if (found) return found;
  const leaves = leavesBelow(cell);
  if (leaves === null) return ownForms(cell);
  const forms = joined(leaves, TRIANGLES * resolution ** 2);
  const all = [...forms, ...ownForms(cell)];
  known.set(cell, all);
  return all;
}

/** Those that are of a cell itself and of no leaf, from fine to coarse, a BlockMap last. */
export function ownForms({ forms, level, blockmap }: Cell): CellForm[] {
  const own = level === 0 ? [] : forms;
  return (blockmap ? [...own, blockmap] : own).map((form, n) => ({
    level: FIRST_OWN + n,
    leaves: [form],
    own: true,
    isMap: form === blockmap,
    resources: [form.leaf],
    listed: [],
    images: new Map(form.entry.textures ?? []),
    told: toldOf(form),
    far: true,
  }));
}

/** Geometry of a cell above the leaves, and of those above it, that is on its way and finer than what of them is there. */
export function comingForms(cell: Cell): readonly Resource[] {
  const coming: Resource[] = [];
  for (let own: Cell | null = cell; own; own = own.parent) {
    for (const leaf of ownForms(own).flatMap(({ resources }) => resources)) {
      if (leaf.held) return coming;
      if (leaf.coming) coming.push(leaf);
    }
  }
  return coming;
}

/** Whether all leaves below are known, as far as they count. */
export function isKnownBelow(cell: Cell): boolean {
  if (whole.has(cell)) return true;
  if (leavesBelow(cell) === null) return false;
  whole.add(cell);
  return true;
}

/** Cells at or below one under which the index has not been read; none where too many leaves are known for them to be geometry together. */
export function unreadBelow(cell: Cell): Cell[] {
  const found: Cell[] = [];
  const waiting = [cell];
  let leaves = 0;
  for (let own = waiting.pop(); own; own = waiting.pop()) {
    if (own.unread) found.push(own);
    else if (own.level > 0) waiting.push(...(own.children ?? []));
    else if (++leaves > MOST_LEAVES) return [];
  }
  return found;
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
 * How well a form shows a cell where a pixel is `width` metres wide: 1 = as the full geometry. From nearer than is told of its own forms
 * go on as pictures do. These lack what leaves below list: as long as those are not known it is missing from the picture, too.
 */
export function accuracyOf(form: CellForm, cell: Cell, pitch: number, width: number): number {
  if (!form.own) return 1 - errorAt(form, pitch, width);
  const shown = pictureAccuracy(form.told, (pitch * 2 ** cell.level) / width);
  return cell.listed > 0 && !form.isMap && !isKnownBelow(cell) ? (1 - cell.listed) * shown : shown;
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

/** The leaves below; none when one of them has no geometry, or there are too many; null: not all are known. */
function leavesBelow(cell: Cell): Cell[] | null {
  const found: Cell[] = [];
  const waiting = [cell];
  for (let own = waiting.pop(); own; own = waiting.pop()) {
    if (own.level > 0 && own.children === null) return null;
    if (own.children?.length) waiting.push(...[...own.children].reverse());
    else if (own.level === 0 && own.geometry && found.length < MOST_LEAVES) found.push(own);
    else if (own.views.size > 0) return [];
  }
  return found;
}

function toldOf({ entry: { errors } }: CellGeometry): readonly number[] {
  return errors?.length ? toldBy(errors) : [0, 0, 0];
}

function joined(leaves: readonly Cell[], mostTriangles: number): CellForm[] {
  const count = Math.max(0, ...leaves.map(({ forms }) => forms.length));
  const listed = new Set(leaves.flatMap(({ instances }) => instances.flatMap(({ forms }) => forms.map(({ mesh }) => mesh))));
  return Array.from({ length: count }, (_, level) => {
    const own = leaves.map(({ forms }) => forms[Math.min(level, forms.length - 1)]!);
    const told = own.map(toldOf);
    const drawn = own.map(({ entry }) => entry.drawn || (entry.instances > 0 ? 0 : entry.triangles));
    const resources = [...new Set(own.flatMap(({ leaf, meshes }) => [...meshes, leaf]))];
    return {
      level,
      leaves: own,
      own: false,
      isMap: false,
      resources,
      listed: resources.filter((resource) => listed.has(resource)),
      images: new Map(own.flatMap(({ entry }) => entry.textures ?? [])),
      told: Array.from({ length: REACHES }, (_, n) => told.reduce((sum, one) => sum + one[n]!, 0) / told.length),
      far: drawn.every((triangles) => triangles > 0) && drawn.reduce((sum, one) => sum + one, 0) <= mostTriangles,
    };
  });
}
