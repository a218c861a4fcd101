import type { Cell, CellGeometry } from "./cell.js";
import { cut, type Cut } from "./cut.js";
import { seesBox, type Frustum } from "./frustum.js";
import { COVERED, HOLE, joinHoles, type Holes } from "./holes.js";
import type { Direction } from "./manifest.js";
import type { Resource } from "./resource.js";
import type { Vector3 } from "./vector.js";
import { BLUR } from "./stream/accuracy.js";
import { sharesOf, tilesWanted, type ViewChoice } from "./views.js";

/** Where the eye is and what it asks for. */
export interface PlanView {
  readonly eye: Vector3;
  readonly frustum: Frustum;
  /** Metres from which a leaf is fine enough. */
  readonly radius: number;
  /** Leaves nearer than this are geometry. */
  readonly near: number;
  /** Leave those leaves out instead: pictures of the far field alone. */
  readonly farOnly: boolean;
  readonly choice: ViewChoice;
}

/** A cell drawn from pictures, for the parts of it that nothing finer covers. */
export interface PictureDraw {
  readonly cell: Cell;
  readonly tiles: readonly Resource[];
  readonly holes: Holes;
}

/** What to draw now, and what would be drawn if everything were there. */
export interface Plan {
  readonly cut: Cut<Cell>;
  readonly pictures: PictureDraw[];
  readonly geometry: CellGeometry[];
  /** How many of `pictures` stand in for others. */
  readonly standIns: number;
}

type Role = "picture" | "geometry" | "left out";

/** Draws each cell of the cut from what is held, and lets what is held above or below stand in for what is not. */
export function makePlan(roots: readonly Cell[], directions: ReadonlyMap<number, Direction>, view: PlanView): Plan {
  return new Planner(directions, view).plan(roots);
}

/** Whether two plans draw the same. */
export function samePlan(a: Plan, b: Plan): boolean {
  const listOf = ({ pictures, geometry }: Plan): unknown[] => [
    ...pictures.flatMap(({ tiles, holes }) => [JSON.stringify(holes), ...tiles]),
    ...geometry.flatMap(({ leaf, meshes }) => [leaf, ...meshes]),
  ];
  const [one, other] = [listOf(a), listOf(b)];
  return one.length === other.length && one.every((part, n) => part === other[n]);
}

class Planner {
  private readonly pictures: PictureDraw[] = [];
  private readonly geometry: CellGeometry[] = [];
  private readonly roles = new Map<Cell, Role>();
  private readonly shares = new Map<Cell, number>();
  private standIns = 0;

  constructor(
    private readonly directions: ReadonlyMap<number, Direction>,
    private readonly view: PlanView,
  ) {}

  plan(roots: readonly Cell[]): Plan {
    const found = cut(roots, this.view.eye, this.view.radius, this.view.near);
    for (const cell of found.pictures) this.roles.set(cell, "picture");
    for (const cell of found.geometry) this.roles.set(cell, this.view.farOnly ? "left out" : "geometry");
    for (const root of roots) {
      const holes = this.place(root);
      if (holes !== COVERED) this.drawWhatIsThere(root, holes);
    }
    return { cut: found, pictures: this.pictures, geometry: this.geometry, standIns: this.standIns };
  }

  /** Draws a cell's part of the cut; returns where that was not possible. */
  private place(cell: Cell): Holes {
    if (!seesBox(this.view.frustum, cell.reach)) return COVERED;
    const role = this.roles.get(cell);
    if (role === "left out") return COVERED;
    if (role === "geometry" && this.drawGeometry(cell)) return COVERED;
    if (role && cell.views.size === 0) return role === "geometry" && cell.geometry ? HOLE : COVERED;
    if (role && this.draw(cell, HOLE)) return COVERED;
    const holes = role ? this.retain(cell) : joinHoles((cell.children ?? []).map((child) => [child.octant, this.place(child)] as const));
    return holes !== COVERED && (this.draw(cell, holes) || this.drawPartly(cell, holes)) ? COVERED : holes;
  }

  /** Keeps what is held below a cell of the cut that is not there yet; returns where nothing is. */
  private retain(cell: Cell): Holes {
    // Below a cell whose index has not been read there is something, but nothing that could be drawn.
    if (cell.heldBelow === 0 || cell.children === null) return HOLE;
    if (cell.level === 0) return this.drawGeometry(cell) ? COVERED : HOLE;
    return joinHoles(
      (cell.children ?? []).map((child) => {
        const drawn = !seesBox(this.view.frustum, child.reach) || this.draw(child, HOLE);
        return [child.octant, drawn ? COVERED : this.retain(child)] as const;
      }),
    );
  }

  /**
   * Draws a cell from pictures for its `holes` if all its tiles are held; or else, while they come in, from those it was
   * drawn from the last time and what has come.
   */
  private draw(cell: Cell, holes: Holes): boolean {
    const wanted = this.wanted(cell);
    if (wanted.length === 0) return false;
    const there = wanted.filter(({ held }) => held);
    if (there.length === wanted.length) cell.shown = wanted;
    else if (cell.shown.length === 0 || !cell.shown.every(({ held }) => held)) return false;
    this.add(cell, there.length === wanted.length ? wanted : [...new Set([...there, ...cell.shown])], holes);
    return true;
  }

  /** Draws a cell for its `holes` from those of its tiles that are held, if nothing above it shows more. */
  private drawPartly(cell: Cell, holes: Holes): boolean {
    const share = this.heldShare(cell);
    if (share === 0) return false;
    for (let above = cell.parent; above; above = above.parent) {
      if (this.heldShare(above) > share * (1 + BLUR * (above.level - cell.level))) return false;
    }
    this.drawWhatIsThere(cell, holes);
    return true;
  }

  /** How much of what a cell's tiles show is shown by those that are held. */
  private heldShare(cell: Cell): number {
    const known = this.shares.get(cell);
    if (known !== undefined) return known;
    const wanted = this.wanted(cell);
    const shares = sharesOf(cell, wanted, this.view.eye);
    const share = wanted.reduce((sum, { held }, n) => sum + (held ? shares[n]! : 0), 0);
    this.shares.set(cell, share);
    return share;
  }

  private wanted(cell: Cell): readonly Resource[] {
    return tilesWanted(cell, this.directions, this.view.eye, this.view.choice);
  }

  /** The last resort, where no ancestor is left to stand in: the tiles that are held, complete or not. */
  private drawWhatIsThere(cell: Cell, holes: Holes): void {
    const tiles = this.wanted(cell).filter(({ held }) => held);
    if (tiles.length > 0) this.add(cell, tiles, holes);
  }

  private add(cell: Cell, tiles: readonly Resource[], holes: Holes): void {
    if (this.roles.get(cell) !== "picture") this.standIns++;
    this.pictures.push({ cell, tiles, holes });
  }

  private drawGeometry(cell: Cell): boolean {
    const near = cell.geometry;
    if (!near || !near.leaf.held || !near.meshes.every((mesh) => mesh.held)) return false;
    this.geometry.push(near);
    return true;
  }
}
