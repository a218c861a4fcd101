import type { Cell, CellGeometry } from "./cell.js";
import { cut, type Cut } from "./cut.js";
import { seesBox, type Frustum } from "./frustum.js";
import { COVERED, HOLE, joinHoles, type Holes } from "./holes.js";
import type { Direction } from "./manifest.js";
import type { Resource } from "./resource.js";
import type { Vector3 } from "./vector.js";
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
  /** How much of what it should show is there. */
  readonly share: number;
  /** Whether parts of finer cells are drawn before it, which show the same. */
  readonly behind: boolean;
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

/** What a cell can be drawn from. */
interface Look {
  readonly tiles: readonly Resource[];
  /** Nothing of it is missing. */
  readonly isWhole: boolean;
  /** It is to be kept until there is more. */
  readonly isNew: boolean;
}

/**
 * Draws each cell of the cut from what is held, and lets what is held above or below stand in for what is not. A cell that is there in
 * part is drawn so, before what stands in for it, which fills its gaps.
 */
export function makePlan(roots: readonly Cell[], directions: ReadonlyMap<number, Direction>, view: PlanView): Plan {
  return new Planner(directions, view).plan(roots);
}

/** Whether two plans draw the same. */
export function samePlan(a: Plan, b: Plan): boolean {
  const listOf = ({ pictures, geometry }: Plan): unknown[] => [
    ...pictures.flatMap(({ tiles, holes, behind }) => [JSON.stringify(holes), behind, ...tiles]),
    ...geometry.flatMap(({ leaf, meshes }) => [leaf, ...meshes]),
  ];
  const [one, other] = [listOf(a), listOf(b)];
  return one.length === other.length && one.every((part, n) => part === other[n]);
}

class Planner {
  private readonly pictures: PictureDraw[] = [];
  private readonly geometry: CellGeometry[] = [];
  private readonly roles = new Map<Cell, Role>();
  private readonly looks = new Map<Cell, Look>();
  private standIns = 0;
  /** How many cells are drawn from parts of what they should show. */
  private parts = 0;

  constructor(
    private readonly directions: ReadonlyMap<number, Direction>,
    private readonly view: PlanView,
  ) {}

  plan(roots: readonly Cell[]): Plan {
    const found = cut(roots, this.view.eye, this.view.radius, this.view.near);
    for (const cell of found.pictures) this.roles.set(cell, "picture");
    for (const cell of found.geometry) this.roles.set(cell, this.view.farOnly ? "left out" : "geometry");
    for (const root of roots) this.place(root);
    return { cut: found, pictures: this.pictures, geometry: this.geometry, standIns: this.standIns };
  }

  /** Draws a cell's part of the cut; returns where that was not possible, or not whole: there what is above is drawn as well. */
  private place(cell: Cell): Holes {
    if (!seesBox(this.view.frustum, cell.reach)) return COVERED;
    const role = this.roles.get(cell);
    if (role === "left out") return COVERED;
    if (role === "geometry" && this.drawGeometry(cell)) return COVERED;
    if (role && cell.views.size === 0) return role === "geometry" && cell.geometry ? HOLE : COVERED;
    if (role && this.look(cell).isWhole) return this.draw(cell, HOLE, false);
    const before = this.parts;
    const holes = role ? this.retain(cell) : joinHoles((cell.children ?? []).map((child) => [child.octant, this.place(child)] as const));
    return holes === COVERED ? COVERED : this.draw(cell, holes, this.parts > before);
  }

  /** Keeps what is held below a cell of the cut that is not there yet; returns where nothing is. */
  private retain(cell: Cell): Holes {
    // Below a cell whose index has not been read there is something, but nothing that could be drawn.
    if (cell.heldBelow === 0 || cell.children === null) return HOLE;
    if (cell.level === 0) return this.drawGeometry(cell) ? COVERED : HOLE;
    return joinHoles(
      (cell.children ?? []).map((child) => {
        if (!seesBox(this.view.frustum, child.reach)) return [child.octant, COVERED] as const;
        return [child.octant, this.look(child).isWhole ? this.draw(child, HOLE, false) : this.retain(child)] as const;
      }),
    );
  }

  /** Draws a cell from pictures for its `holes`; returns where it is not whole. */
  private draw(cell: Cell, holes: Holes, behind: boolean): Holes {
    const { tiles, isWhole, isNew } = this.look(cell);
    if (tiles.length === 0) return holes;
    if (isNew) [cell.shown, cell.wasWhole] = [tiles, isWhole];
    if (!isWhole) this.parts++;
    if (this.roles.get(cell) !== "picture") this.standIns++;
    this.pictures.push({ cell, tiles, holes, share: isWhole ? 1 : this.heldShare(cell), behind });
    return isWhole ? COVERED : holes;
  }

  /** What there is of a cell's pictures: while tiles come in, what it was drawn from before and what has come. */
  private look(cell: Cell): Look {
    const known = this.looks.get(cell);
    if (known) return known;
    const wanted = this.wanted(cell);
    const there = wanted.filter(({ held }) => held);
    const isComplete = wanted.length > 0 && there.length === wanted.length;
    const kept = isComplete ? [] : cell.shown.filter(({ held }) => held);
    const stays = !isComplete && cell.wasWhole && kept.length === cell.shown.length;
    const tiles = isComplete ? wanted : [...new Set([...there, ...kept])];
    const look = { tiles, isWhole: isComplete || stays, isNew: !stays };
    this.looks.set(cell, look);
    return look;
  }

  /** How much of what a cell's tiles show is shown by those that are held. */
  private heldShare(cell: Cell): number {
    const wanted = this.wanted(cell);
    const shares = sharesOf(cell, wanted, this.view.eye);
    return wanted.reduce((sum, { held }, n) => sum + (held ? shares[n]! : 0), 0);
  }

  private wanted(cell: Cell): readonly Resource[] {
    return tilesWanted(cell, this.directions, this.view.eye, this.view.choice);
  }

  private drawGeometry(cell: Cell): boolean {
    const near = cell.geometry;
    if (!near || !near.leaf.held || !near.meshes.every((mesh) => mesh.held)) return false;
    this.geometry.push(near);
    return true;
  }
}
