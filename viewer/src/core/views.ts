import type { Cell, CellView } from "./cell.js";
import { viewBin } from "./directions.js";
import type { Direction } from "./manifest.js";
import { dot, middleOf, type Vector3 } from "./vector.js";

/** How much of each cell is drawn. */
export interface ViewChoice {
  /** Directions a cell. */
  readonly views: number;
  /** Depth layers a direction: 1 or 2. */
  readonly layers: number;
}

/**
 * All views of a cell in the order in which they serve the eye: first the list of its view bin, then the others by angle
 * (spec/drawing.md, Which tiles).
 */
export function rankedViews(cell: Cell, directions: ReadonlyMap<number, Direction>, eye: Vector3): CellView[] {
  const middle = middleOf(cell.bounds);
  const listed = cell.bins[viewBin(middle, eye)] ?? [];
  const towards: Vector3 = [eye[0] - middle[0], eye[1] - middle[1], eye[2] - middle[2]];
  const cosine = ({ direction }: CellView): number => dot(directions.get(direction)?.vector ?? [0, 0, 0], towards);
  const first = listed.flatMap((direction) => cell.views.get(direction) ?? []);
  const rest = [...cell.views.values()].filter((view) => !listed.includes(view.direction));
  rest.sort((a, b) => cosine(b) - cosine(a) || a.direction - b.direction);
  return [...first, ...rest];
}

/** How many of the ranked views are to be drawn: no more than the bin lists, where it lists any. */
export function viewsWanted(cell: Cell, eye: Vector3, choice: ViewChoice): number {
  const listed = cell.bins[viewBin(middleOf(cell.bounds), eye)]?.length ?? 0;
  return Math.min(choice.views, listed || cell.views.size);
}

/** The layers of a view that are drawn. */
export function layersOf(view: CellView, choice: ViewChoice): CellView["layers"] {
  return view.layers.filter((layer, number) => layer !== undefined && number < choice.layers);
}
