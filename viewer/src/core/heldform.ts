import type { Cell } from "./cell.js";
import { accuracyOf, errorAt, finestAfar, formsOf, isKnownBelow, isWithinReach, mayListInstances, meshesBelow, ownForms, pixelWidth, type CellForm } from "./cellforms.js";
import { bestShown, heldBoards, sightOf, type HeldBoards } from "./impostors.js";
import { MESH_FARTHEST } from "./indextile.js";
import { heldMesh, type Instance, type MeshForm, type PlacedMesh } from "./instances.js";
import type { Direction } from "./manifest.js";
import type { Resource } from "./resource.js";
import { pictureAccuracy } from "./stream/accuracy.js";
import { distanceTo, type Vector3 } from "./vector.js";
import { sharesOf, tilesWanted, type ViewChoice } from "./views.js";

/**
 * Accuracy that instances in a cell may lack, on the mean, beside its pictures, for its own form to take their place: what is told of
 * meshes has half as much on top.
 */
const LESS = 0.25;

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

/** The form that is held and shows most of a cell farther away than near, if that is as much as pictures, held so far, do. */
export function heldForm(cell: Cell, view: FarView, pictures: number): CellForm | null {
  const { eye, grid } = view;
  if (!mayBeGeometry(view)) return null;
  const reaches = isWithinReach(distanceTo(cell.bounds, eye), grid.leafSize);
  const held = formsOf(cell, grid.resolution).filter((form) => isHeld(form) && (form.own || (form.far && reaches)));
  // Pictures show what is placed in the cell as well.
  const may = pictures < 1 || !held.some(({ own }) => own) || showsInstances(cell, view) ? held : held.filter(({ own }) => !own);
  return bestOf(may, cell, view, pictures);
}

/** The same of the forms of a cell above the leaves alone: that by which it stands in. */
export function heldOwnForm(cell: Cell, view: FarView, pictures: number): CellForm | null {
  if (!mayBeGeometry(view)) return null;
  const form = bestOf(ownForms(cell).filter(isHeld), cell, view, pictures);
  return form && (pictures < 1 || showsInstances(cell, view)) ? form : null;
}

/**
 * A form of a cell above that is held and stands in for a cell at least as well as all of its pictures would show it; null: there is none,
 * or pictures stand in before it.
 */
export function heldFormAbove(cell: Cell, view: FarView, directions: ReadonlyMap<number, Direction>): CellForm | null {
  if (!mayBeGeometry(view)) return null;
  for (let above = cell.parent; above; above = above.parent) {
    const isCovered = arePicturesHeld(above, view, directions);
    const form = bestOf(ownForms(above).filter(isHeld), cell, view, 1, above);
    if (form && (!isCovered || showsInstances(above, view))) return form;
    if (isCovered) return null;
  }
  return null;
}

function arePicturesHeld(cell: Cell, { eye, choice }: FarView, directions: ReadonlyMap<number, Direction>): boolean {
  const areHeld = (tiles: readonly Resource[]): boolean => tiles.length > 0 && tiles.every(({ held }) => held);
  return (cell.wasWhole && areHeld(cell.shown)) || areHeld(tilesWanted(cell, directions, eye, choice));
}

/** How much of what a cell's pictures show is held. */
export function heldShare(cell: Cell, view: FarView, directions: ReadonlyMap<number, Direction>): number {
  const wanted = tilesWanted(cell, directions, view.eye, view.choice);
  const shares = sharesOf(cell, wanted, view.eye);
  return wanted.reduce((sum, { held }, n) => sum + (held ? shares[n]! : 0), 0);
}

function mayBeGeometry({ near, farGeometry }: FarView): boolean {
  return near > 0 && farGeometry;
}

function isHeld({ resources }: CellForm): boolean {
  return resources.every(({ held }) => held);
}

/** Of forms of a cell, or of one above it, that which shows most, the first of those that show as much, if it is at least as much as such a share of the pictures. */
function bestOf(forms: readonly CellForm[], cell: Cell, { eye, focal, grid }: FarView, pictures: number, of = cell): CellForm | null {
  if (forms.length === 0) return null;
  const pitch = grid.leafSize / grid.resolution;
  const width = pixelWidth(cell.bounds, distanceTo(cell.bounds, eye), focal);
  const each = forms.map((form) => accuracyOf(form, of, pitch, width));
  const most = Math.max(...each);
  const shown = pictures * shownByPictures(cell, pitch, width);
  return most >= shown ? forms[each.indexOf(most)]! : null;
}

/**
 * How well all of a cell's own pictures show it where a pixel is `width` metres wide: above the leaves no better than where their pixels
 * are as wide as the screen's, as is measured.
 */
function shownByPictures({ told, level }: Pick<Cell, "told" | "level">, pitch: number, width: number): number {
  const own = (pitch * 2 ** level) / width;
  return pictureAccuracy(told, level > 0 ? Math.max(own, 1) : own);
}

/**
 * Whether each instance that is listed below a cell farther away than near can be drawn by something that is held, and all of them, on the
 * mean, about as well as the cell's pictures show them.
 */
function showsInstances(cell: Cell, view: FarView): boolean {
  if (!isKnownBelow(cell)) return !mayListInstances(cell);
  const { eye, focal, grid } = view;
  const pitch = grid.leafSize / grid.resolution;
  const finest = finestAfar(cell, grid.resolution);
  const shown = [...meshesBelow(cell)].flatMap(([forms, all]) => {
    const form = finest < Infinity ? heldMesh(forms, finest) : null;
    const boards = heldBoards(all[0]!.impostors);
    return all.flatMap((placed) => placed.instances.map((instance) => instanceShown(placed, instance, form, boards, view)));
  });
  if (shown.length === 0) return true;
  const pictures = shownByPictures(cell, pitch, pixelWidth(cell.bounds, distanceTo(cell.bounds, eye), focal));
  const mean = shown.reduce<number>((sum, one) => sum + (one ?? 0), 0) / shown.length;
  return shown.every((one) => one !== null) && mean >= pictures - LESS;
}

/** How much of an instance is shown by a form of its mesh, or by the best of some boards; null: it cannot be drawn. */
function instanceShown(
  placed: PlacedMesh, instance: Instance, form: MeshForm | null, boards: readonly HeldBoards[], { eye, focal, grid }: FarView,
): number | null {
  const pitch = grid.leafSize / grid.resolution;
  const width = pixelWidth(instance.bounds, distanceTo(instance.bounds, eye), focal);
  const least = form ? 1 - errorAt(form, pitch, width, MESH_FARTHEST) : 0;
  const [board, shown] = boards.length > 0 ? bestShown(boards, sightOf(placed, instance, eye), pitch, width, least) : [null, least];
  return form || board ? shown : null;
}
