import type { Cell } from "./cell.js";
import { seesBox } from "./frustum.js";
import type { Plan, PlanView } from "./plan.js";
import { dot, type Box, type Vector3 } from "./vector.js";

/** Leaves that are to be geometry count as this level: a picture in their place is at least one coarser. */
const GEOMETRY_LEVEL = -1;
/** Rays that the shares are counted by: across and down. */
const RAYS = [32, 24] as const;

/** How much of a picture is not as it should be. */
export interface Shown {
  /** Cells of the cut within the frustum in whose place nothing is drawn: no part of them, nothing below, nothing above. */
  readonly empty: number;
  /** Share of the picture in which something coarser stands in for what should be there. */
  readonly standInShare: number;
  /** Levels by which that is coarser, on average over that share; 0 without any. */
  readonly standInLevels: number;
}

/** How a picture is seen, as rows: x = (toX · c) / (toW · c) for c from the eye. */
export interface Projection {
  readonly toX: Vector3;
  readonly toY: Vector3;
  readonly toW: Vector3;
  /** Pixels. */
  readonly width: number;
  readonly height: number;
}

/**
 * Compares what a plan draws with its cut. Shares are of a grid of rays, each of which meets the first cell through the floor of
 * whose bounds it goes: that is where most of a cell is seen, while its box may have the eye in it.
 */
export function shownBy(plan: Plan, view: PlanView, projection: Projection): Shown {
  const levels = new LevelsShown(plan, view);
  const seen = levels.cells().filter(({ reach }) => seesBox(view.frustum, reach));
  const missing = new Map(seen.map((cell) => [cell, levels.missing(cell)]));
  let [hit, standing, coarser] = [0, 0, 0];
  for (const direction of raysOf(projection)) {
    const first = firstHit(seen, view.eye, direction);
    if (!first) continue;
    hit++;
    const lacking = missing.get(first)!;
    if (lacking <= 0 || lacking === Infinity) continue;
    standing++;
    coarser += lacking;
  }
  return {
    empty: [...missing.values()].filter((lacking) => lacking === Infinity).length,
    standInShare: hit > 0 ? standing / hit : 0,
    standInLevels: standing > 0 ? coarser / standing : 0,
  };
}

/** What is drawn in the place of each cell of a cut. */
class LevelsShown {
  private readonly shares: ReadonlyMap<Cell, number>;
  private readonly leaves: ReadonlySet<unknown>;
  private readonly asGeometry: ReadonlySet<Cell>;

  constructor(
    private readonly plan: Plan,
    private readonly view: PlanView,
  ) {
    this.shares = new Map([...plan.pictures.map(({ cell, share }) => [cell, share] as const), ...plan.solids.map(({ cell }) => [cell, 1] as const)]);
    this.leaves = new Set(plan.geometry);
    this.asGeometry = new Set(plan.cut.geometry);
  }

  /** Those of the cut that have something to show, or of which nothing is known. */
  cells(): Cell[] {
    const { pictures, geometry } = this.plan.cut;
    const pictured = pictures.filter(({ views, unread }) => views.size > 0 || unread);
    return this.view.farOnly ? pictured : [...pictured, ...geometry.filter(({ views, geometry: near }) => near || views.size > 0)];
  }

  /** Levels by which what is drawn is coarser than it should be; Infinity: nothing is drawn. */
  missing(cell: Cell): number {
    if (this.plan.afar.has(cell)) return 0;
    if (this.asGeometry.has(cell) && cell.geometry) {
      return this.isGeometry(cell) ? 0 : this.above(cell) - GEOMETRY_LEVEL;
    }
    return this.isCoveredBelow(cell) ? 0 : this.above(cell) - cell.level;
  }

  /** Level of what is drawn at or above a cell, nearest first, as far as each fills what is left by those before it. */
  private above(cell: Cell): number {
    let [level, left] = [Infinity, 1];
    for (let found: Cell | null = cell; found && left > 0; found = found.parent) {
      const share = this.shares.get(found);
      if (share === undefined) continue;
      level = (level === Infinity ? 0 : level) + left * share * found.level;
      left *= 1 - share;
      // Gaps that nothing fills count as if the next level did.
      if (!found.parent) level += left * (found.level + 1);
    }
    return level;
  }

  private isGeometry({ forms }: Cell): boolean {
    return forms.some((form) => this.leaves.has(form));
  }

  private isCoveredBelow(cell: Cell): boolean {
    if (cell.heldBelow === 0 || cell.children === null) return false;
    if (cell.level === 0) return this.isGeometry(cell);
    const seen = cell.children.filter(({ reach }) => seesBox(this.view.frustum, reach));
    return seen.every((child) => this.plan.afar.has(child) || this.shares.get(child) === 1 || this.isCoveredBelow(child));
  }
}

function* raysOf({ toX, toY, toW, width, height }: Projection): Generator<Vector3> {
  const [columns, rows] = RAYS;
  const [acrossX, acrossY, ahead] = [cross(toY, toW), cross(toW, toX), cross(toX, toY)];
  // Which way round the rows are says the sign of their volume.
  const sign = Math.sign(dot(toX, acrossX));
  for (let n = 0; n < columns * rows; n++) {
    const [x, y] = [(((n % columns) + 0.5) / columns) * width, ((Math.floor(n / columns) + 0.5) / rows) * height];
    const along = (a: 0 | 1 | 2): number => sign * (x * acrossX[a] + y * acrossY[a] + ahead[a]);
    yield [along(0), along(1), along(2)];
  }
}

function firstHit(cells: readonly Cell[], eye: Vector3, direction: Vector3): Cell | null {
  let [first, least]: [Cell | null, number] = [null, Infinity];
  for (const cell of cells) {
    const at = reaching(cell.bounds, eye, direction);
    if (at < least) [first, least] = [cell, at];
  }
  return first;
}

/** Where a ray goes through the floor of a box, in its own lengths; Infinity when it does not. */
function reaching({ lower, upper }: Box, eye: Vector3, direction: Vector3): number {
  const at = (lower[2] - eye[2]) / direction[2];
  if (!(at >= 0)) return Infinity;
  const [x, y] = [eye[0] + at * direction[0], eye[1] + at * direction[1]];
  return x >= lower[0] && x <= upper[0] && y >= lower[1] && y <= upper[1] ? at : Infinity;
}

function cross(a: Vector3, b: Vector3): Vector3 {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}
