import { describe, expect, it } from "vitest";
import { Cell, SharedMeshes } from "../src/core/cell.js";
import { accuracyOf, formsOf } from "../src/core/cellforms.js";
import type { CellKey } from "../src/core/grid.js";
import { heldForm } from "../src/core/heldform.js";
import { COVERED, HOLE, spread, type Holes } from "../src/core/holes.js";
import type { CellEntry, InstancedMesh } from "../src/core/indextile.js";
import { makePlan, samePlan, type Plan } from "../src/core/plan.js";
import { shownBy } from "../src/core/shown.js";
import type { Vector3 } from "../src/core/vector.js";
import { listWants } from "../src/core/wants.js";
import { DIRECTIONS, GRID, hold, makeWorld, MANIFEST, tilesOf, view } from "./worlds.js";

const STATUE: InstancedMesh = {
  bounds: [[0, 0, 0], [3, 0.5, 0.5]],
  levels: [{ hash: "a1", bytes: 300, triangles: 900 }, { hash: "a2", bytes: 30, triangles: 9, errors: [20, 40, 80] }],
  objects: [7], transforms: [[1, 0, 0, 0.2, 0, 1, 0, 0.2, 0, 0, 1, 0]],
};

const form = (hash: string, error: number) => ({
  hash, bytes: 200, triangles: 50, instances: 0, meshes: [], textures: [["33", 90]] as const, drawn: 50, errors: [error, error, error],
});

/** Cells above the leaves have geometry in two forms, pictures that look unlike them, and one leaf a statue. */
function makeSolidWorld(own: (key: CellKey) => Partial<CellEntry> = () => ({})) {
  const world = makeWorld((key) => ({
    errors: [100, 100, 100],
    ...(key.level > 0 && { geometry: { ...form("20", 10), levels: [form("21", 60)] } }),
    ...own(key),
  }));
  const cell = (name: string): Cell => world.cells.get(name)!;
  const leafOf = (name: string, level = 0) => cell(name).forms[level]!.leaf;
  return { ...world, cell, leafOf };
}

/** Of what is to be seen of the cells above it, a statue takes most. */
const LISTED = 220;

const withStatue = ({ level, x, y }: CellKey, instances = [STATUE]): Partial<CellEntry> => {
  if (x > 0 || y > 0) return {};
  return level === 0 ? { instances } : { geometry: { ...form("20", 10), levels: [form("21", 60)], listed: LISTED } };
};

/** Four cells of level 1 make up the cut. */
const AFAR = { near: 0.1, radius: 2, eye: [2, -5, 0.5] as Vector3, farGeometry: true };
/** All leaves do. */
const CLOSE = { ...AFAR, radius: 100 };
const plan = (root: Cell, changes = {}): Plan => makePlan([root], DIRECTIONS, view({ ...AFAR, ...changes }));
const solids = (found: Plan): string[] => found.solids.map(({ cell, form: { level } }) => `${cell.name} ${level}`);
const drawn = (found: Plan): string[] => found.pictures.map(({ cell }) => cell.name);

describe("geometry of cells above the leaves", () => {
  it("is read with the cell, and found by its key", () => {
    const { cell } = makeSolidWorld();
    const { forms } = cell("1/0/0/0");
    expect(forms.map(({ level, leaf }) => [level, leaf.key])).toEqual([[0, "geometry/1/0/0/0-20"], [1, "geometry/1/0/0/0-21"]]);
    expect(cell("1/0/0/0").find("geometry/1/0/0/0-21")).toBe(forms[1]!.leaf);
  });

  it("comes after what the leaves below are together, with errors from where a pixel is two of its own wide", () => {
    const { root, cell, leafOf } = makeSolidWorld();
    const all = formsOf(cell("1/0/0/0"), GRID.resolution);
    expect(all.map(({ level, own, far }) => [level, own, far])).toEqual([[0, false, true], [32, true, true], [33, true, true]]);
    expect(all[1]).toMatchObject({ leaves: [cell("1/0/0/0").forms[0]], resources: [leafOf("1/0/0/0")], listed: [] });
    expect([...all[1]!.images]).toEqual([["33", 90]]);
    const shows = (width: number): number => accuracyOf({ ...all[1]!, told: [0, 0.5, 0.75] }, cell("1/0/0/0"), 1, width);
    expect([8, 4, 2, 1, 0.25].map(shows)).toEqual([1, 1, 0.75, 0.5, 0.25]);
    // Nearer than is told it is seen to be simple.
    expect(shows(1 / 16)).toBeCloseTo(0, 12);
    cell("1/1/1/0").children = null;
    expect(formsOf(root, GRID.resolution).map(({ level }) => level)).toEqual([32, 33]);
    const { told } = formsOf(cell("0/0/0/0"), GRID.resolution)[0]!;
    expect(told).toEqual([0, 0, 0]);
  });

  it("is what shows most of what is held, the finer when two show the same, and that of leaves only within their reach", () => {
    const { cell, leafOf } = makeSolidWorld();
    const seen = view(AFAR);
    const held = (eye = AFAR.eye) => heldForm(cell("1/0/0/0"), { ...seen, eye }, 0)?.level;
    expect(held()).toBeUndefined();
    hold([leafOf("1/0/0/0", 1)]);
    expect(held()).toBe(33);
    hold([leafOf("1/0/0/0")]);
    expect(held()).toBe(32);
    hold(["0/0/0/0", "0/1/0/0", "0/0/1/0", "0/1/1/0"].map((name) => leafOf(name)));
    expect(held()).toBe(0);
    expect(held([0, -200, 0])).toBe(32);
    expect(heldForm(cell("1/0/0/0"), { ...seen, near: 0 }, 0)).toBeNull();
    expect(heldForm(cell("1/0/0/0"), { ...seen, farGeometry: false }, 0)).toBeNull();
  });

  it("is drawn in place of pictures, which are not wanted then", () => {
    const { root, cell, leafOf } = makeSolidWorld();
    for (const own of [root, cell("1/0/0/0")]) hold(tilesOf(own));
    hold([leafOf("1/0/0/0", 1)]);
    const found = plan(root);
    expect(solids(found)).toEqual(["1/0/0/0 1"]);
    expect(found.solids[0]).toMatchObject({ holes: HOLE, behind: false });
    expect([...found.afar]).toEqual([cell("1/0/0/0")]);
    expect(found.geometry).toEqual([]);
    expect(drawn(found)).toEqual(["2/0/0/0"]);
    const wanted = listWants([root], found, MANIFEST, view(AFAR)).filter((want) => want.resource.cell === cell("1/0/0/0"));
    expect(wanted.map(({ resource }) => resource.key)).toEqual(["geometry/1/0/0/0-21"]);
    expect(shownBy(found, view(AFAR), { toX: [50, 0, -200], toY: [0, 50, -200], toW: [0, 0, -1], width: 400, height: 400 }).empty).toBe(0);
  });

  it("is not, where pictures show more", () => {
    const { root, cell, leafOf } = makeSolidWorld(({ level }) => (level === 1 ? { errors: [5, 5, 5] } : {}));
    hold([leafOf("1/0/0/0")]);
    expect(solids(plan(root))).toEqual(["1/0/0/0 0"]);
    hold(tilesOf(cell("1/0/0/0")).slice(0, 1));
    expect(solids(plan(root))).toEqual(["1/0/0/0 0"]);
    hold(tilesOf(cell("1/0/0/0")));
    expect(solids(plan(root))).toEqual([]);
  });

  it("is drawn with the instances in it, and while pictures are there only if all can be", () => {
    const { root, cell, leafOf } = makeSolidWorld(withStatue);
    const [{ forms }] = cell("0/0/0/0").instances as [Cell["instances"][number]];
    hold([leafOf("1/0/0/0")]);
    expect(solids(plan(root))).toEqual(["1/0/0/0 0"]);
    hold(tilesOf(cell("1/0/0/0")));
    expect(drawn(plan(root))).toEqual(["1/0/0/0"]);
    // Its full mesh has too many triangles for so far away.
    hold([forms[0]!.mesh]);
    expect(solids(plan(root))).toEqual([]);
    hold([forms[1]!.mesh]);
    const found = plan(root);
    expect(solids(found)).toEqual(["1/0/0/0 0"]);
    expect(found.instances.map(({ form: { mesh } }) => mesh.key)).toEqual(["mesh/a2"]);
  });

  it("is taken to lack what leaves below list as long as these are not known", () => {
    const shown = (changes: Partial<Cell>): number => {
      const cell = Object.assign(makeSolidWorld().cell("1/0/0/0"), changes);
      return accuracyOf(formsOf(cell, 16).find((form) => form.own)!, cell, 1 / 16, 0.01);
    };
    const unknown = { children: null, indexHash: "ab" };
    expect(shown({})).toBeGreaterThan(0.5);
    expect(shown({ listed: 0.6 })).toBe(shown({}));
    expect(shown(unknown)).toBe(shown({}));
    expect(shown({ ...unknown, listed: 0.6 })).toBeCloseTo(0.4 * shown({}), 9);
  });

  it("is not in place of pictures that show the instances in it much better", () => {
    const far = { near: 0.1, radius: 2, eye: [2, -12, 0.5] as Vector3 };
    const solidsWith = (levelErrors: readonly number[], pictureErrors: readonly number[]): string[] => {
      const [full, coarse] = STATUE.levels as [InstancedMesh["levels"][number], InstancedMesh["levels"][number]];
      const instances = [{ ...STATUE, levels: [full, { ...coarse, errors: levelErrors }] }];
      const { root, cell, leafOf } = makeSolidWorld(({ level, x, y }) => ({
        errors: pictureErrors,
        ...withStatue({ level, x, y, z: 0 }, instances),
      }));
      hold([leafOf("2/0/0/0"), ...tilesOf(root), cell("0/0/0/0").instances[0]!.forms[1]!.mesh]);
      return solids(plan(root, far));
    };
    // Pictures show .61; a quarter less may do for instances.
    expect(solidsWith([160, 160, 160], [100, 100, 100])).toEqual(["2/0/0/0 0"]);
    expect(solidsWith([180, 180, 180], [100, 100, 100])).toEqual([]);
    // From where their pixels are narrower than the screen's the pictures of cells above the leaves are taken to show no more than there.
    expect(solidsWith([40, 40, 40], [0, 255, 255])).toEqual(["2/0/0/0 0"]);
    expect(solidsWith([40, 40, 40], [0, 0, 0])).toEqual([]);
  });

  it("is drawn with those that reach into the picture from beside it", () => {
    const { root, cell, leafOf } = makeSolidWorld(withStatue);
    hold([leafOf("1/0/0/0"), cell("0/0/0/0").instances[0]!.forms[1]!.mesh]);
    const found = plan(root, { frustum: [{ normal: [1, 0, 0] as Vector3, offset: -2.7 }] });
    expect(found.solids).toEqual([]);
    expect(found.instances).toHaveLength(1);
  });

  it("is drawn with what reaches into it from cells that are there by pictures", () => {
    const reaching = ({ level, x, y, z }: CellKey): Partial<CellEntry> => withStatue({ level, x, y, z }, [{ ...STATUE, transforms: [[1, 0, 0, 0.2, 0, 1, 0, 0.2, 0, 0, 1, 0]] }]);
    const { root, cell, leafOf } = makeSolidWorld(reaching);
    hold([cell("0/0/0/0").instances[0]!.forms[1]!.mesh, ...tilesOf(cell("1/0/0/0"))]);
    expect(plan(root).instances).toEqual([]);
    hold([leafOf("1/1/0/0")]);
    const found = plan(root);
    expect(solids(found)).toEqual(["1/1/0/0 0"]);
    expect(drawn(found)).toEqual(["1/0/0/0"]);
    expect(found.instances).toHaveLength(1);
  });

  it("keeps instances in front where finer cells than those of the cut are drawn so", () => {
    const { root, cell, leafOf } = makeSolidWorld(withStatue);
    hold([cell("0/0/0/0").instances[0]!.forms[1]!.mesh]);
    hold(["1/0/0/0", "1/1/0/0", "1/0/1/0", "1/1/1/0"].map((name) => leafOf(name)));
    const found = plan(root, { radius: 0.5 });
    expect(found.cut.pictures).toEqual([root]);
    expect(solids(found)).toHaveLength(4);
    expect(found.instances).toHaveLength(1);
  });

  it("does not make a near leaf of a cell without cells below", () => {
    const { root, cell, leafOf } = makeSolidWorld();
    cell("1/0/0/0").children = [];
    hold([leafOf("1/0/0/0")]);
    expect(formsOf(root, GRID.resolution).filter(({ own }) => !own)).toEqual([]);
  });

  it("is found anew by the next generation", () => {
    const { root } = makeSolidWorld();
    const { root: other } = makeSolidWorld();
    const [before] = root.forms;
    const next = new Cell(root.key, null, GRID, root);
    next.read(new Map([[root.name, { ...entry(root), geometry: { ...form("20", 10) } }]]), new SharedMeshes(), "test");
    expect(next.forms[0]!.leaf).toBe(before!.leaf);
    expect(other.forms[0]!.leaf).not.toBe(before!.leaf);
  });
});

function entry({ name, bounds }: Cell): CellEntry {
  return { key: name, bounds: [bounds.lower, bounds.upper], error: 1 };
}

describe("what stands in as geometry", () => {
  it("does so for what nothing finer covers, and nothing above it is drawn", () => {
    const { root, cell, leafOf } = makeSolidWorld();
    hold(tilesOf(root));
    hold([leafOf("1/0/0/0", 1)]);
    for (const name of ["0/0/0/0", "0/1/1/0"]) hold(tilesOf(cell(name)));
    const found = plan(root, CLOSE);
    expect(solids(found)).toEqual(["1/0/0/0 1"]);
    expect(found.solids[0]).toMatchObject({ holes: [COVERED, HOLE, HOLE, COVERED, COVERED, HOLE, HOLE, COVERED], behind: false });
    expect(drawn(found)).toEqual(["0/0/0/0", "0/1/1/0", "2/0/0/0"]);
    expect(found.pictures[2]!.holes).toEqual([COVERED, HOLE, HOLE, HOLE, 0, 0, 0, 0]);
    expect(found.standIns).toBe(2);
    expect(found.afar.size).toBe(0);
  });

  it("stands behind parts of finer pictures, and where it is beside instances, which it does not show", () => {
    const { root, cell, leafOf } = makeSolidWorld(withStatue);
    hold([leafOf("2/0/0/0")]);
    expect(plan(root, CLOSE).solids).toMatchObject([{ cell: root, holes: HOLE, behind: false }]);
    hold(tilesOf(cell("0/3/3/0")).slice(0, 1));
    expect(plan(root, CLOSE).solids).toMatchObject([{ cell: root, holes: HOLE, behind: true }]);
    hold(tilesOf(cell("0/3/3/0")));
    expect(plan(root, CLOSE).solids).toMatchObject([{ behind: false }]);
    hold([cell("0/0/0/0").instances[0]!.forms[1]!.mesh]);
    const found = plan(root, CLOSE);
    expect(found.solids).toMatchObject([{ behind: false }]);
    expect(found.instances).toHaveLength(1);
  });

  it("leaves pictures of cells above in place that show more than ground without what stands on it", () => {
    for (const place of [AFAR, CLOSE]) {
      const { root, cell, leafOf } = makeSolidWorld(withStatue);
      hold([leafOf("1/0/0/0")]);
      expect(solids(plan(root, place))).toEqual(["1/0/0/0 0"]);
      hold(tilesOf(root));
      expect(solids(plan(root, place))).toEqual([]);
      expect(drawn(plan(root, place))).toEqual(["2/0/0/0"]);
      hold([cell("0/0/0/0").instances[0]!.forms[1]!.mesh]);
      expect(solids(plan(root, place))).toEqual(["1/0/0/0 0"]);
    }
  });

  it("does before whole pictures that show less, unless these show an instance that cannot be drawn", () => {
    const { root, cell, leafOf } = makeSolidWorld(withStatue);
    hold([leafOf("2/0/0/0", 1), ...tilesOf(root)]);
    expect(solids(plan(root, CLOSE))).toEqual([]);
    expect(drawn(plan(root, CLOSE))).toEqual(["2/0/0/0"]);
    hold([cell("0/0/0/0").instances[0]!.forms[1]!.mesh]);
    expect(solids(plan(root, CLOSE))).toEqual(["2/0/0/0 1"]);
    expect(drawn(plan(root, CLOSE))).toEqual([]);
    // Nothing finer is waited for that would show less.
    const wants = listWants([root], plan(root, CLOSE), MANIFEST, view(CLOSE));
    expect(wants.filter(({ resource: { held }, urgency }) => !held && urgency <= 1)).toEqual([]);
  });

  it("does not where its pictures show more so far", () => {
    const poor = makeSolidWorld(({ level }) => (level === 2 ? { geometry: form("20", 200) } : {}));
    hold([poor.leafOf("2/0/0/0")]);
    hold(tilesOf(poor.root).slice(0, 1));
    expect(solids(plan(poor.root, CLOSE))).toEqual([]);
  });

  it("leaves nothing to be wanted of cells that it shows better than their pictures, unless pictures stand in before it", () => {
    const { root, cell, leafOf } = makeSolidWorld();
    const wanted = (): boolean => {
      const seen = view(CLOSE);
      return listWants([root], makePlan([root], DIRECTIONS, seen), MANIFEST, seen).some(({ resource }) => resource.cell === cell("0/0/0/0"));
    };
    expect(wanted()).toBe(true);
    hold([leafOf("2/0/0/0")]);
    expect(wanted()).toBe(false);
    hold(tilesOf(cell("1/0/0/0")));
    expect(drawn(plan(root, CLOSE))).toEqual(["1/0/0/0"]);
    expect(wanted()).toBe(true);
    hold([leafOf("1/0/0/0")]);
    expect(wanted()).toBe(false);
  });

  it("is wanted as it comes, as long as it is finer than what there is of it", () => {
    const { root, cell, leafOf } = makeSolidWorld();
    const wanted = (): string[] => {
      const seen = view(CLOSE);
      const wants = listWants([root], makePlan([root], DIRECTIONS, seen), MANIFEST, seen);
      return wants.map(({ resource }) => resource.key).filter((key) => /geometry.[12]/.test(key));
    };
    expect(wanted()).toEqual([]);
    for (const form of [leafOf("2/0/0/0"), leafOf("1/0/0/0", 1)]) form.state = "fetched";
    expect(wanted().sort()).toEqual(["geometry/1/0/0/0-21", "geometry/2/0/0/0-20"]);
    hold([leafOf("2/0/0/0")]);
    expect(wanted()).toContain("geometry/1/0/0/0-21");
    hold([leafOf("1/0/0/0")]);
    expect(wanted()).not.toContain("geometry/1/0/0/0-21");
    expect(cell("1/0/0/0").heldBelow).toBe(1);
  });

  it("stands in for near leaves, which are drawn as they come", () => {
    const { root, cell, leafOf } = makeSolidWorld();
    hold([leafOf("2/0/0/0")]);
    const near = { ...CLOSE, near: 100 };
    expect(solids(plan(root, near))).toEqual(["2/0/0/0 0"]);
    hold([...cell("2/0/0/0").children!.flatMap(({ children }) => children!.map(({ name }) => leafOf(name)))]);
    const found = plan(root, near);
    expect(solids(found)).toEqual([]);
    expect(found.geometry).toHaveLength(16);
  });

  it("makes another plan", () => {
    const { root, cell, leafOf } = makeSolidWorld();
    hold([leafOf("2/0/0/0", 1)]);
    const first = plan(root, CLOSE);
    expect(samePlan(first, plan(root, CLOSE))).toBe(true);
    hold(tilesOf(cell("0/0/0/0")).slice(0, 1));
    const second = plan(root, CLOSE);
    expect(samePlan({ ...second, pictures: first.pictures }, first)).toBe(false);
    hold([leafOf("2/0/0/0")]);
    expect(samePlan(plan(root, CLOSE), second)).toBe(false);
  });
});

describe("spread", () => {
  const octants = (...all: number[]) => all.map((octant) => ({ octant, children: null }));

  it("leaves whole cells, and octants that hold something, as they are", () => {
    expect(spread(HOLE, { octant: 0, children: octants(0) })).toBe(HOLE);
    const mixed: Holes = [HOLE, COVERED, HOLE, COVERED, COVERED, HOLE, HOLE, HOLE];
    expect(spread(mixed, { octant: 0, children: octants(0, 1, 2, 3, 4, 5, 6, 7) })).toEqual(mixed);
  });

  it("takes what is above or below before what is beside", () => {
    const holes: Holes = [HOLE, COVERED, 0, 0, 0, 0, 0, 0];
    expect(spread(holes, { octant: 0, children: octants(0, 1) })).toEqual([HOLE, COVERED, HOLE, COVERED, HOLE, COVERED, HOLE, COVERED]);
  });

  it("mirrors what lies below", () => {
    const inner: Holes = [HOLE, 0, 0, 0, COVERED, 0, 0, 0];
    const all: Holes = [inner, HOLE, HOLE, HOLE, 0, 0, 0, 0];
    const cell = { octant: 0, children: [{ octant: 0, children: octants(0, 4) }, ...octants(1, 2, 3)] };
    const [first, , , , above] = spread(all, cell) as [unknown, unknown, unknown, unknown, unknown];
    expect(first).toEqual([HOLE, HOLE, HOLE, HOLE, COVERED, COVERED, COVERED, COVERED]);
    expect(above).toEqual([COVERED, COVERED, COVERED, COVERED, HOLE, HOLE, HOLE, HOLE]);
  });
});
