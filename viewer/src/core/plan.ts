import { isHeld, type Cell, type CellGeometry } from "./cell.js";
import { boundsOfInstances, errorAt, finestAfar, meshesBelow, pixelWidth, type CellForm } from "./cellforms.js";
import { cut, type Cut } from "./cut.js";
import { seesBox, type Frustum } from "./frustum.js";
import { heldForm, heldOwnForm, heldShare, instancesPictured, MORE, type FarView } from "./heldform.js";
import { COVERED, HOLE, joinHoles, spread, type Holes } from "./holes.js";
import type { CellKey } from "./grid.js";
import { bestShown, heldBoards, placedAlone, sightOf, type Board, type HeldBoards, type ImpostorForm } from "./impostors.js";
import { MESH_FARTHEST } from "./indextile.js";
import { heldMesh, type Instance, type MeshForm, type PlacedMesh } from "./instances.js";
import type { Direction } from "./manifest.js";
import type { Resource } from "./resource.js";
import { distanceTo, farthestIn, type Box } from "./vector.js";
import { tilesWanted } from "./views.js";

/** Where the eye is and what it asks for. */
export interface PlanView extends FarView {
  readonly frustum: Frustum;
  /** Metres from which a leaf is fine enough. */
  readonly radius: number;
  /** Leave those leaves out instead: pictures of the far field alone. */
  readonly farOnly: boolean;
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

/** A cell above the leaves drawn as geometry of its own, for the parts of it that nothing finer covers. */
export interface SolidDraw {
  readonly cell: Cell;
  readonly form: CellGeometry;
  readonly holes: Holes;
  /** As of a PictureDraw. */
  readonly behind: boolean;
}

/** Instances drawn whole by themselves, where the cell that they are in is not there: by a form of their mesh, or one by a board. */
export interface InstancesDraw {
  readonly placed: PlacedMesh;
  readonly form: MeshForm | Board;
}

/** What to draw now, and what would be drawn if everything were there. */
export interface Plan {
  readonly cut: Cut<Cell>;
  readonly pictures: PictureDraw[];
  /** Leaves. */
  readonly geometry: CellGeometry[];
  /** Cells above them. */
  readonly solids: SolidDraw[];
  /** In addition to what stands in for the cells that they are in. */
  readonly instances: InstancesDraw[];
  /** Cells farther away than near that are drawn as geometry, all leaves below them or by geometry of their own. */
  readonly afar: ReadonlySet<Cell>;
  /** How many of `pictures` and `solids` stand in for others. */
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
  const listOf = ({ pictures, geometry, solids, instances }: Plan): unknown[] => [
    ...pictures.flatMap(({ tiles, holes, behind }) => [JSON.stringify(holes), behind, ...tiles]),
    ...solids.flatMap(({ form, holes, behind }) => [JSON.stringify(holes), behind, form.leaf]),
    ...geometry.flatMap(({ leaf, meshes }) => [leaf, ...meshes]),
    ...instances.flatMap(({ placed, form }) => [placed, form.mesh]),
  ];
  const [one, other] = [listOf(a), listOf(b)];
  return one.length === other.length && one.every((part, n) => part === other[n]);
}

class Planner {
  private readonly pictures: PictureDraw[] = [];
  private readonly geometry: CellGeometry[] = [];
  private readonly solids: SolidDraw[] = [];
  private readonly instances: InstancesDraw[] = [];
  private readonly afar = new Set<Cell>();
  /** Cells of the cut in whose place finer ones are kept, all of them. */
  private readonly kept = new Set<Cell>();
  private readonly roles = new Map<Cell, Role>();
  private readonly looks = new Map<Cell, Look>();
  private readonly shares = new Map<Cell, number>();
  private readonly boards = new Map<readonly ImpostorForm[], readonly HeldBoards[]>();
  private standIns = 0;
  /** Cells in which instances are drawn by themselves, and those above them. */
  private readonly withInstances = new Set<Cell>();
  /** How many cells are drawn from parts of what they should show. */
  private parts = 0;
  /** How many cells are drawn without the instances in them. */
  private bare = 0;

  constructor(
    private readonly directions: ReadonlyMap<number, Direction>,
    private readonly view: PlanView,
  ) {}

  plan(roots: readonly Cell[]): Plan {
    const found = cut(roots, this.view.eye, this.view.radius, this.view.near);
    for (const cell of found.pictures) this.roles.set(cell, "picture");
    for (const cell of found.geometry) this.roles.set(cell, this.view.farOnly ? "left out" : "geometry");
    for (const root of roots) this.place(root);
    this.placeInstances(found);
    const { geometry, solids, instances, afar, standIns } = this;
    const pictures = this.pictures.map((draw) => this.behindInstances(draw));
    return { cut: found, pictures, geometry, solids, instances, afar, standIns };
  }

  /** Draws a cell's part of the cut; returns where that was not possible, or not whole: there what is above is drawn as well. */
  private place(cell: Cell): Holes {
    if (!seesBox(this.view.frustum, cell.reach)) return COVERED;
    const role = this.roles.get(cell);
    if (role === "left out") return COVERED;
    if (role === "geometry" && this.drawGeometry(cell)) return COVERED;
    if (role === "picture" && this.drawAfar(cell)) return COVERED;
    if (role && cell.views.size === 0) return role === "geometry" && cell.geometry ? HOLE : COVERED;
    if (role && this.look(cell).isWhole) return this.draw(cell, HOLE, false);
    const [before, bare] = [this.parts, this.bare];
    const holes = role ? this.retain(cell) : joinHoles((cell.children ?? []).map((child) => [child.octant, this.place(child)] as const));
    if (role && holes === COVERED && this.bare === bare) this.kept.add(cell);
    return holes === COVERED ? COVERED : this.draw(cell, holes, this.parts > before);
  }

  /** Keeps what is held below a cell of the cut that is not there yet; returns where nothing is. */
  private retain(cell: Cell): Holes {
    // Below a cell whose index has not been read there is something, but nothing that could be drawn.
    if (cell.heldBelow === 0 || cell.children === null) return HOLE;
    if (cell.level === 0) return this.drawGeometry(cell) ? COVERED : HOLE;
    return joinHoles(
      (cell.children ?? []).map((child) => {
        if (!seesBox(this.view.frustum, child.reach) || this.drawAfar(child)) return [child.octant, COVERED] as const;
        return [child.octant, this.look(child).isWhole ? this.draw(child, HOLE, false) : this.retain(child)] as const;
      }),
    );
  }

  /** Draws a cell from pictures for its `holes`, or one above as geometry of its own; returns where it is not whole. */
  private draw(cell: Cell, holes: Holes, behind: boolean): Holes {
    const { tiles, isWhole, isNew } = this.look(cell);
    const form = this.roles.has(cell) ? null : heldOwnForm(cell, this.view, this.shareOf(cell), this.shareOf);
    if (form) {
      this.standIns++;
      this.solids.push({ cell, form: form.leaves[0]!, holes: spread(holes, cell), behind });
      return COVERED;
    }
    if (tiles.length === 0) return holes;
    if (isNew) [cell.shown, cell.wasWhole] = [tiles, isWhole];
    if (!isWhole) this.parts++;
    if (this.roles.get(cell) !== "picture") this.standIns++;
    this.pictures.push({ cell, tiles, holes, share: this.shareOf(cell), behind });
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
  private readonly shareOf = (cell: Cell): number => {
    const known = this.shares.get(cell);
    if (known !== undefined) return known;
    const share = this.look(cell).isWhole ? 1 : heldShare(cell, this.view, this.directions);
    this.shares.set(cell, share);
    return share;
  };

  private wanted(cell: Cell): readonly Resource[] {
    return tilesWanted(cell, this.directions, this.view.eye, this.view.choice);
  }

  /** Draws a cell as geometry, or all leaves below it, if that shows more than what there is of its pictures. */
  private drawAfar(cell: Cell): boolean {
    const form = this.formAfar(cell);
    if (!form) return false;
    this.afar.add(cell);
    if (!form.own) {
      for (const leaf of form.leaves) if (seesBox(this.view.frustum, leaf.leaf.cell!.reach)) this.geometry.push(leaf);
      return true;
    }
    if (!form.isMap) this.bare++;
    this.solids.push({ cell, form: form.leaves[0]!, holes: HOLE, behind: false });
    return true;
  }

  private formAfar(cell: Cell): CellForm | null {
    return heldForm(cell, this.view, this.shareOf(cell), this.shareOf);
  }

  private drawGeometry(cell: Cell): boolean {
    const form = cell.forms.find(isHeld);
    if (form) this.geometry.push(form);
    return form !== undefined;
  }

  /** Draws what is placed in cells of the cut that are not there, as far as it is held. It may reach into the picture from beside it. */
  private placeInstances({ pictures, geometry }: Cut<Cell>): void {
    const { eye, frustum, near, farOnly, farGeometry } = this.view;
    if (near <= 0) return;
    const shown = this.shownByLeaves();
    const drawn = new Set(this.pictures.map(({ cell }) => cell));
    const shareOf = (cell: Cell): number => (drawn.has(cell) ? this.shareOf(cell) : 0);
    for (const cell of [...(farGeometry ? pictures : []), ...(farGeometry || !farOnly ? geometry : [])]) {
      const bounds = boundsOfInstances(cell);
      if (!bounds || !seesBox(frustum, bounds)) continue;
      const isThere = this.isThere(cell);
      if (isThere && this.solids.length === 0) continue;
      const before = this.instances.length;
      const least = this.afar.has(cell) ? 0 : instancesPictured(cell, this.view, shareOf) - MORE;
      const finest = this.roles.get(cell) === "geometry" ? 0 : finestAfar(cell, this.view.grid.resolution);
      for (const [forms, all] of meshesBelow(cell)) {
        const form = finest === Infinity ? null : heldMesh(forms, finest);
        const boards = this.boardsBeside(form, all[0]!.impostors);
        if (!form && boards.length === 0) continue;
        for (const placed of all) {
          const isLeftOut = farOnly && this.roles.get(cell) === "left out" && farthestIn(placed.bounds, eye) < near;
          if (isLeftOut || shown.has(placed) || !seesBox(frustum, placed.bounds) || (isThere && !this.lacksPart(placed, cell))) continue;
          this.drawInstances(placed, form, boards, isThere ? 0 : least);
        }
      }
      if (this.instances.length > before) for (let own: Cell | null = cell; own; own = own.parent) this.withInstances.add(own);
    }
  }

  /** Whether what is placed in a cell that is there reaches into others that are drawn by geometry of their own, which does not show it. */
  private lacksPart({ bounds }: PlacedMesh, home: Cell): boolean {
    return this.solids.some(({ cell, form }) => cell !== home && form !== cell.blockmap && overlap(bounds, cell.box));
  }

  /** Pictures that stand in for a cell with instances that are drawn by themselves show them, too, coarser: they go behind them. */
  private behindInstances(draw: PictureDraw): PictureDraw {
    const isAbove = !this.roles.has(draw.cell) && this.withInstances.has(draw.cell);
    return isAbove && !draw.behind ? { ...draw, behind: true } : draw;
  }

  /** Boards of a mesh that are there, unless what else there is of it looks like the mesh itself. */
  private boardsBeside(form: MeshForm | null, impostors: readonly ImpostorForm[]): readonly HeldBoards[] {
    if (impostors.length === 0 || form?.told.every((error) => error === 0)) return [];
    const found = this.boards.get(impostors) ?? heldBoards(impostors);
    this.boards.set(impostors, found);
    return found;
  }

  /** Each by what shows most of it, a form before a board; what shows less than `least` is not drawn, a form of those of a leaf together. */
  private drawInstances(placed: PlacedMesh, held: MeshForm | null, boards: readonly HeldBoards[], least: number): void {
    const { instances } = placed;
    const form = held && (least <= 0 || this.shownOf(held, placed.bounds) >= least) ? held : null;
    const found = boards.length > 0 ? instances.map((instance) => this.boardFor(placed, instance, form, boards, least)) : [];
    if (form && !found.some(Boolean)) {
      this.instances.push({ placed, form });
      return;
    }
    found.forEach((board, n) => {
      const shown = board ?? form;
      if (shown) this.instances.push({ placed: placedAlone(placed, instances[n]!, board), form: shown });
    });
  }

  private boardFor(placed: PlacedMesh, instance: Instance, form: MeshForm | null, boards: readonly HeldBoards[], least: number): Board | null {
    const { eye, focal } = this.view;
    const width = pixelWidth(instance.bounds, distanceTo(instance.bounds, eye), focal);
    const shown = form ? this.shownOf(form, instance.bounds) : 0;
    return bestShown(boards, sightOf(placed, instance, eye), this.pitch, width, Math.max(shown, least))[0];
  }

  private shownOf(form: MeshForm, bounds: Box): number {
    const { eye, focal } = this.view;
    return 1 - errorAt(form, this.pitch, pixelWidth(bounds, distanceTo(bounds, eye), focal), MESH_FARTHEST);
  }

  private get pitch(): number {
    const { leafSize, resolution } = this.view.grid;
    return leafSize / resolution;
  }

  /** What is placed in leaves that are drawn as geometry and reaches into no other ones, which would lack their part of it. */
  private shownByLeaves(): Set<PlacedMesh> {
    const leaves = this.geometry.map(({ leaf }) => leaf.cell!);
    // What reaches into leaves that are left out is left out there.
    const leftOut = [...this.roles].flatMap(([cell, role]) => (role === "left out" ? [cell] : []));
    const drawn = new Set([...leaves, ...leftOut].map(({ name }) => name));
    const { leafSize } = this.view.grid;
    return new Set(leaves.flatMap(({ key, instances }) => instances.filter((placed) => isWithin(placed, key, leafSize, drawn))));
  }

  /**
   * Whether all of a cell of the cut is drawn from pictures as it should be or, beside the picture, would be; what is placed in leaves
   * that are geometry is told by `shownByLeaves`.
   */
  private isThere(cell: Cell): boolean {
    if (this.roles.get(cell) === "geometry") return !seesBox(this.view.frustum, cell.reach) && cell.forms.some(isHeld);
    if (this.afar.has(cell) || this.roles.get(cell) === "left out") return false;
    if (this.kept.has(cell) || this.look(cell).isWhole) return true;
    return !seesBox(this.view.frustum, cell.reach) && this.formAfar(cell)?.own === false;
  }
}

function overlap(a: Box, b: Box): boolean {
  return [0, 1, 2].every((n) => a.lower[n]! < b.upper[n]! && b.lower[n]! < a.upper[n]!);
}

/** Whether all leaves that something placed in one of them reaches into are among those named. */
function isWithin({ corner, instances }: PlacedMesh, { x, y, z }: CellKey, leafSize: number, names: ReadonlySet<string>): boolean {
  return instances.every(({ bounds: { lower, upper } }) => {
    const range = (a: 0 | 1 | 2): number[] => {
      const first = Math.floor((lower[a] - corner[a]) / leafSize);
      const count = Math.floor((upper[a] - corner[a]) / leafSize) - first + 1;
      return Array.from({ length: count }, (_, n) => first + n);
    };
    return range(0).every((i) => range(1).every((j) => range(2).every((k) => names.has(`0/${x + i}/${y + j}/${z + k}`))));
  });
}
