import type { Cell, CellView } from "./cell.js";
import { viewBin } from "./directions.js";
import type { Direction } from "./manifest.js";
import type { Resource } from "./resource.js";
import { dot, middleOf, type Vector3 } from "./vector.js";

/** How much of each cell is drawn. */
export interface ViewChoice {
  /** Directions a cell; null: the tiles that the index picks. */
  readonly views: number | null;
  /** Pixels of a view that a kilobyte of a picked tile must add. */
  readonly leastGain: number;
  /** Depth layers a direction: 1 or 2. */
  readonly layers: number;
}

/** A tile that is picked for a view bin. */
export interface Pick {
  readonly tile: Resource;
  readonly direction: number;
  readonly layer: number;
  /** Pixels of a view that it adds to those before it, a kilobyte. */
  readonly gain: number;
}

/** Directions of a cell for which the index picks no tiles. */
const VIEWS_WITHOUT_PICKS = 3;

/** The tiles to draw a cell from, best first (spec/drawing.md, Which tiles). */
export function tilesWanted(cell: Cell, directions: ReadonlyMap<number, Direction>, eye: Vector3, choice: ViewChoice): readonly Resource[] {
  const bin = viewBin(middleOf(cell.bounds), eye);
  const picks = choice.views === null ? cell.picks[bin] : undefined;
  if (picks) return picked(picks, choice);
  const views = viewsFrom(cell, bin, directions, eye).slice(0, choice.views ?? VIEWS_WITHOUT_PICKS);
  return views.flatMap(({ layers }) => layers.filter((layer, number) => layer !== undefined && number < choice.layers));
}

/** How much of what all the tiles that are wanted of a cell show is shown by each; the sum is 1. */
export function sharesOf(cell: Cell, wanted: readonly Resource[], eye: Vector3): readonly number[] {
  const picks = cell.picks[viewBin(middleOf(cell.bounds), eye)] ?? [];
  const shows = wanted.map((tile) => {
    const pick = picks.find((one) => one.tile === tile);
    return pick ? pick.gain * tile.bytes : 0;
  });
  const sum = shows.reduce((all, one) => all + one, 0);
  return sum > 0 ? shows.map((one) => one / sum) : wanted.map(() => 1 / wanted.length);
}

function picked(picks: readonly Pick[], { layers, leastGain }: ViewChoice): Resource[] {
  return picks
    .filter(({ layer }) => layer < layers)
    .filter(({ gain }, place) => place === 0 || gain >= leastGain)
    .map(({ tile }) => tile);
}

/** The views that the cell lists for the bin; of a cell without lists all, by angle. */
function viewsFrom(cell: Cell, bin: number, directions: ReadonlyMap<number, Direction>, eye: Vector3): CellView[] {
  const listed = cell.bins[bin] ?? [...new Set((cell.picks[bin] ?? []).map(({ direction }) => direction))];
  if (listed.length > 0) return listed.flatMap((direction) => cell.views.get(direction) ?? []);
  const middle = middleOf(cell.bounds);
  const towards: Vector3 = [eye[0] - middle[0], eye[1] - middle[1], eye[2] - middle[2]];
  const cosine = ({ direction }: CellView): number => dot(directions.get(direction)?.vector ?? [0, 0, 0], towards);
  return [...cell.views.values()].sort((a, b) => cosine(b) - cosine(a) || a.direction - b.direction);
}
