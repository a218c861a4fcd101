import { isHeld, type Cell } from "./cell.js";
import { comingForms, meshesBelow } from "./cellforms.js";
import { seesBox, type Frustum } from "./frustum.js";
import { heldForm, heldFormAbove, nearForm } from "./heldform.js";
import { comingBoards } from "./impostors.js";
import { comingMeshes } from "./instances.js";
import type { Manifest } from "./manifest.js";
import type { Plan, PlanView } from "./plan.js";
import type { Resource } from "./resource.js";
import { distanceTo } from "./vector.js";
import { tilesWanted } from "./views.js";

/** Why something is wanted; the lower the number, the sooner it is fetched. */
export const URGENCY = {
  /** The roots, so that there is a picture at once. */
  root: 0,
  /** What the picture shows. */
  seen: 1,
  /** Geometry in the picture that is many times as large as the pictures that stand in for it meanwhile. */
  detail: 2,
  /** What the picture will show soon, as the eye moves (ahead.ts). */
  ahead: 3,
  /** Ancestors of the cut, to stand in when the eye moves on, and pictures of near leaves, much smaller than their geometry. */
  cover: 4,
  /** The cut outside the picture, for when the eye turns. */
  unseen: 5,
} as const;

/** Whether the picture needs it now. */
export function isNeeded(urgency: number): boolean {
  return urgency <= URGENCY.detail;
}

/** A value that would be drawn if it were there. */
export interface Want {
  readonly resource: Resource;
  readonly urgency: number;
  /** Place in the order of what adds most for its bytes; left out: it adds nothing that is known of. */
  readonly rank?: number;
  readonly distance: number;
  readonly level: number;
}

/** Geometry of a leaf that takes more bytes than this is waited for last: its pictures take a tenth or less. */
const DETAIL_BYTES = 1 << 20;
/** Levels from a cell of the cut up to the ancestor that is kept to stand in for it. */
const COVER_LEVELS = 2;

function isBad({ state }: Resource): boolean {
  return state === "bad";
}

/**
 * Everything a plan has a use for, most urgent first: in the picture, then near, then coarse. `lacks` tells what cannot be
 * had, in whose place parents are wanted; `from` is where distances are measured from.
 */
export function listWants(
  roots: readonly Cell[], plan: Pick<Plan, "cut">, manifest: Manifest, view: PlanView,
  lacks: (resource: Resource) => boolean = isBad, from = view.eye,
): Want[] {
  const wants = new Map<Resource, Want>();
  const add = (resources: readonly Resource[], cell: Cell, urgency: number): void => {
    const distance = distanceTo(cell.box, from);
    for (const resource of resources) {
      const known = wants.get(resource);
      if (known && known.urgency <= urgency) continue;
      wants.set(resource, { resource, urgency, distance, level: cell.level });
    }
  };
  /** Returns whether all of them are there. */
  const addPictures = (cell: Cell, urgency: number): boolean => {
    const tiles = tilesWanted(cell, manifest.directions, view.eye, view.choice);
    add(tiles, cell, urgency);
    if (cell.parent && tiles.some(lacks)) addPictures(cell.parent, urgency);
    return tiles.length > 0 && tiles.every(({ held }) => held);
  };
  /** What comes of instances and of geometry above is wanted, to be drawn until the cell is there. What to ask for, who puts wants in order decides. */
  const addComing = (cell: Cell, urgency: number): void => {
    if (urgency !== URGENCY.seen || view.near <= 0) return;
    if (view.farGeometry) add(comingForms(cell), cell, urgency);
    for (const [forms, all] of meshesBelow(cell)) {
      const coming = [...comingMeshes(forms), ...comingBoards(all[0]!.impostors)];
      if (coming.length > 0) add(coming.map(({ mesh }) => mesh), cell, urgency);
    }
  };
  const addGeometry = (cell: Cell, urgency: number): void => {
    const near = nearForm(cell, view);
    const parts = near ? [near.leaf, ...near.meshes] : [];
    const absent = parts.reduce((sum, { held, bytes }) => sum + (held ? 0 : bytes), 0);
    const isLarge = urgency === URGENCY.seen && absent > DETAIL_BYTES;
    add(parts, cell, isLarge ? URGENCY.detail : urgency);
    addPictures(cell, isLarge ? urgency : URGENCY.cover);
    if (!near || parts.some(lacks)) addPictures(cell, urgency);
    if (!cell.forms.some(isHeld)) addComing(cell, urgency);
  };

  for (const root of roots) addPictures(root, URGENCY.root);
  const urgencyOf = (cell: Cell): number => (seesBox(view.frustum, cell.reach) ? URGENCY.seen : URGENCY.unseen);
  for (const cell of plan.cut.pictures) {
    // What is shown better by geometry that is there needs no pictures.
    const form = heldForm(cell, view, 1) ?? heldFormAbove(cell, view, manifest.directions);
    if (form) add(form.resources, cell, urgencyOf(cell));
    const isThere = form ? !form.own : addPictures(cell, urgencyOf(cell));
    if (!isThere && view.farGeometry) addComing(cell, urgencyOf(cell));
    addCover(cell, (ancestor) => addPictures(ancestor, URGENCY.cover));
  }
  if (!view.farOnly) for (const cell of plan.cut.geometry) addGeometry(cell, urgencyOf(cell));
  return [...wants.values()].sort(byUrgency);
}

/** The same with what can stand in for the picture ahead of the picture itself: soon coarse everywhere instead of fine somewhere. */
export function coarseFirst(wants: readonly Want[], frustum: Frustum): Want[] {
  const standsIn = ({ urgency, resource: { cell } }: Want): boolean => urgency === URGENCY.cover && cell !== null && seesBox(frustum, cell.reach);
  return wants.map((want) => (standsIn(want) ? { ...want, urgency: URGENCY.root } : want)).sort(byUrgency);
}

function addCover(cell: Cell, add: (ancestor: Cell) => void): void {
  let ancestor: Cell | null = cell;
  for (let n = 0; n < COVER_LEVELS && ancestor; n++) ancestor = ancestor.parent;
  if (ancestor) add(ancestor);
}

/** Order of wants: urgent, then what adds most, then near, then coarse. */
export function byUrgency(a: Want, b: Want): number {
  return a.urgency - b.urgency || rankOf(a) - rankOf(b) || a.distance - b.distance || b.level - a.level;
}

/** A number also where there is none, so that two can be subtracted. */
function rankOf({ rank }: Want): number {
  return rank ?? Number.MAX_SAFE_INTEGER;
}
