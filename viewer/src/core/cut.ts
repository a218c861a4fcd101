import type { Grid } from "./grid.js";
import { distanceTo, type Box, type Vector3 } from "./vector.js";

/** What the cut needs to know of a cell. */
export interface CutCell<Self> {
  readonly level: number;
  readonly box: Box;
  /** Cells below that hold something, ascending; null while the index is not known that far down. */
  readonly children: readonly Self[] | null;
}

/** Which cells are shown how, in order of discovery (depth first, children ascending). */
export interface Cut<C> {
  /** Cells drawn from orthoviews. */
  readonly pictures: C[];
  /** Leaves nearer than the near radius. */
  readonly geometry: C[];
  /** Those of `pictures` that stand there only because the index below them is not known yet. */
  readonly unknown: C[];
}

/** Metres at which a pixel of a leaf is as wide as one of a picture `width` pixels wide; `horizontalFov` in radians. */
export function nearRadius(grid: Grid, width: number, horizontalFov: number): number {
  return (grid.leafSize * width) / (2 * grid.resolution * Math.tan(horizontalFov / 2));
}

/**
 * Cells to draw from `eye`, local metres; the same as `farfield.octree.cut.cut` (shared vectors in tests/vectors/cut).
 *
 * radius: distance from which a leaf is fine enough, nearRadius / 2^bias; a cell of level L is taken from radius * 2^L on.
 * near: leaves nearer than this are geometry; 0 shows everything from pictures.
 */
export function cut<C extends CutCell<C>>(roots: readonly C[], eye: Vector3, radius: number, near: number): Cut<C> {
  const result: Cut<C> = { pictures: [], geometry: [], unknown: [] };
  const pending = [...roots].reverse();
  for (let cell = pending.pop(); cell; cell = pending.pop()) {
    const away = distanceTo(cell.box, eye);
    if (cell.level === 0) (away < near ? result.geometry : result.pictures).push(cell);
    else if (away >= radius * 2 ** cell.level && away >= near) result.pictures.push(cell);
    else if (cell.children === null) {
      result.pictures.push(cell);
      result.unknown.push(cell);
    } else {
      for (let n = cell.children.length - 1; n >= 0; n--) pending.push(cell.children[n]!);
    }
  }
  return result;
}
