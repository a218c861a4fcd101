import { isHeld as isFormHeld, type Cell, type CellGeometry } from "./cell.js";
import { accuracyOf, errorAt, finestAfar, formsOf, isKnownBelow, isWithinReach, meshesBelow, ownForms, pixelWidth, type CellForm } from "./cellforms.js";
import { bestShown, heldBoards, sightOf, type HeldBoards } from "./impostors.js";
import { MESH_FARTHEST } from "./indextile.js";
import { heldMesh, type Instance, type MeshForm, type PlacedMesh } from "./instances.js";
import type { Direction } from "./manifest.js";
import type { Resource } from "./resource.js";
import { lossFrom, pictureAccuracy, toldBy } from "./stream/accuracy.js";
import { distanceTo, type Vector3 } from "./vector.js";
import { sharesOf, tilesWanted, type ViewChoice } from "./views.js";

/** Accuracy that instances are taken to have above what is told of their meshes, which is for a view from nearer and has half as much on top. */
export const MORE = 0.25;

/** Error up to which a form looks like the full geometry: what adds less is not fetched by its benefit either. */
const ENOUGH = 0.02;

interface Best {
  readonly form: CellForm;
  /** How much it shows. */
  readonly shown: number;
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

/** How much of what a cell's pictures show is held. */
export type ShareOf = (cell: Cell) => number;

/**
 * The form that is held and shows most of a cell farther away than near, if that is as much as pictures, held so far, do: its own, of which
 * `pictures` tells the share, and those of cells above.
 */
export function heldForm(cell: Cell, view: FarView, pictures: number, shareOf: ShareOf | null = null): CellForm | null {
  const { eye, grid } = view;
  if (!mayBeGeometry(view)) return null;
  const reaches = isWithinReach(distanceTo(cell.bounds, eye), grid.leafSize);
  const held = formsOf(cell, grid.resolution).filter((form) => isHeld(form) && (form.own || (form.far && reaches)));
  return unlessAboveShowsMore(bestOf(held, cell, view, pictures), cell, view, shareOf);
}

/** The same of the forms of a cell above the leaves alone: that by which it stands in. */
export function heldOwnForm(cell: Cell, view: FarView, pictures: number, shareOf: ShareOf): CellForm | null {
  if (!mayBeGeometry(view)) return null;
  return unlessAboveShowsMore(bestOf(ownForms(cell).filter(isHeld), cell, view, pictures), cell, view, shareOf);
}

/**
 * A form of a cell above that is held and stands in for a cell at least as well as all of its pictures would show it; null: there is none,
 * or pictures stand in before it.
 */
export function heldFormAbove(cell: Cell, view: FarView, directions: ReadonlyMap<number, Direction>): CellForm | null {
  if (!mayBeGeometry(view)) return null;
  for (let above = cell.parent; above; above = above.parent) {
    const found = bestOf(ownForms(above).filter(isHeld), cell, view, 1, above);
    if (found) return found.form;
    if (arePicturesHeld(above, view, directions)) return null;
  }
  return null;
}

function arePicturesHeld(cell: Cell, { eye, choice }: FarView, directions: ReadonlyMap<number, Direction>): boolean {
  const areHeld = (tiles: readonly Resource[]): boolean => tiles.length > 0 && tiles.every(({ held }) => held);
  return (cell.wasWhole && areHeld(cell.shown)) || areHeld(tilesWanted(cell, directions, eye, choice));
}

/**
 * The form that a near leaf is wanted in: the coarsest that looks like the full one from there, or a finer one that is held already. Of a
 * city from a height, most of what is near shows nothing of its largest images.
 */
export function nearForm({ bounds, forms }: Cell, { eye, focal, grid }: FarView): CellGeometry | null {
  const pitch = grid.leafSize / grid.resolution;
  const width = pixelWidth(bounds, distanceTo(bounds, eye), focal);
  const isEnough = ({ entry: { errors } }: CellGeometry): boolean => !errors?.length || errorAt({ told: toldBy(errors) }, pitch, width) <= ENOUGH;
  const last = forms.findLastIndex(isEnough);
  return forms.slice(0, last).find(isFormHeld) ?? forms[last] ?? null;
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
function bestOf(forms: readonly CellForm[], cell: Cell, view: FarView, pictures: number, of = cell): Best | null {
  if (forms.length === 0) return null;
  const { eye, focal, grid } = view;
  const pitch = grid.leafSize / grid.resolution;
  const width = pixelWidth(cell.bounds, distanceTo(cell.bounds, eye), focal);
  const placed = forms.some(({ own }) => own) && of.listed > 0 && isKnownBelow(of) ? of.listed * instancesShown(of, view) : 0;
  const each = forms.map((form) => {
    const shown = accuracyOf(form, of, pitch, width);
    if (!form.own || form.isMap || of.listed === 0) return shown;
    return isKnownBelow(of) ? (1 - of.listed) * shown + placed : shown;
  });
  const most = Math.max(...each);
  return most >= pictures * shownByPictures(cell, pitch, width) ? { form: forms[each.indexOf(most)]!, shown: most } : null;
}

function unlessAboveShowsMore(best: Best | null, cell: Cell, view: FarView, shareOf: ShareOf | null): CellForm | null {
  if (!best || !shareOf) return best && best.form;
  for (const { above, shown } of picturesOf(cell, view)) {
    if (above !== cell && shown > best.shown && shareOf(above) * shown > best.shown) return null;
  }
  return best.form;
}

/** How well all pictures of a cell, and then of each one above it, show that cell: from link to link something is lost. */
function* picturesOf(cell: Cell, { eye, focal, grid }: FarView): Iterable<{ above: Cell; shown: number; sharp: number }> {
  const pitch = grid.leafSize / grid.resolution;
  const width = pixelWidth(cell.bounds, distanceTo(cell.bounds, eye), focal);
  let shown = shownByPictures(cell, pitch, width);
  for (let above: Cell | null = cell; above; above = above.parent) {
    const own = pitch * 2 ** above.level;
    yield { above, shown, sharp: Math.min(width / own, 1) };
    shown *= 1 - lossFrom(above.loss, (2 * own) / width);
  }
}

/**
 * How well instances in a cell are shown by pictures that are drawn of it and of cells above, of which `shareOf` tells the share: as sharp
 * as these are, and by the square of the share, as through a wall that is missing one sees the backs of others.
 */
export function instancesPictured(cell: Cell, view: FarView, shareOf: ShareOf): number {
  let most = 0;
  for (const { above, shown, sharp } of picturesOf(cell, view)) most = Math.max(most, shareOf(above) ** 2 * shown * sharp);
  return most;
}

/**
 * How well all of a cell's own pictures show it where a pixel is `width` metres wide: above the leaves no better than where their pixels
 * are as wide as the screen's, as is measured.
 */
function shownByPictures({ told, level }: Pick<Cell, "told" | "level">, pitch: number, width: number): number {
  const own = (pitch * 2 ** level) / width;
  return pictureAccuracy(told, level > 0 ? Math.max(own, 1) : own);
}

/** How much of the instances that are listed below a cell farther away than near is drawn by what is held, by their sizes on the mean. */
function instancesShown(cell: Cell, view: FarView): number {
  const finest = finestAfar(cell, view.grid.resolution);
  let [sum, all] = [0, 0];
  for (const [forms, listed] of meshesBelow(cell)) {
    const form = finest < Infinity ? heldMesh(forms, finest) : null;
    const boards = heldBoards(listed[0]!.impostors);
    for (const placed of listed) {
      for (const instance of placed.instances) {
        const { lower, upper } = instance.bounds;
        const side = Math.hypot(upper[0] - lower[0], upper[1] - lower[1]) * (upper[2] - lower[2]);
        all += side;
        const shown = form || boards.length > 0 ? instanceShown(placed, instance, form, boards, view) : null;
        if (shown !== null) sum += side * Math.min(shown + MORE, 1);
      }
    }
  }
  return all > 0 ? sum / all : 0;
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
