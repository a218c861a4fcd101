import { describe, expect, it } from "vitest";
import { Cell, SharedMeshes } from "../src/core/cell.js";
import { boundsOfInstances, errorAt, finestAfar, instancesBelow, meshesBelow } from "../src/core/cellforms.js";
import { MESH_FARTHEST, type CellEntry, type InstancedMesh } from "../src/core/indextile.js";
import { comingMeshes, heldMesh, meshForm, outsideOf, placedMesh, type MeshForm } from "../src/core/instances.js";
import { makePlan, samePlan, type Plan } from "../src/core/plan.js";
import { Resource } from "../src/core/resource.js";
import type { Box, Vector3 } from "../src/core/vector.js";
import { listWants, URGENCY } from "../src/core/wants.js";
import { DIRECTIONS, GRID, hold, makeWorld, MANIFEST, tilesOf, view } from "./worlds.js";

const hash = (n: number): string => n.toString(16).padStart(16, "0");

/** A statue in the middle of a leaf, full and in a coarse form. */
const STATUE: InstancedMesh = {
  bounds: [[-0.1, -0.1, 0], [0.1, 0.1, 0.5]],
  levels: [
    { hash: hash(1), bytes: 900, triangles: 200, textures: [[hash(7), 5000]] },
    { hash: hash(2), bytes: 90, triangles: 20, errors: [51, 102] },
  ],
  objects: [5],
  transforms: [[1, 0, 0, 0.5, 0, 1, 0, 0.5, 0, 0, 1, 0]],
};

/** The world with such a statue in each leaf, and its resources from fine to coarse. */
function statues(changes: Partial<CellEntry> = {}) {
  const world = makeWorld({ instances: [STATUE], ...changes });
  const meshes = world.cells.get("0/0/0/0")!.instances[0]!.forms.map(({ mesh }) => mesh);
  return { ...world, full: meshes[0]!, coarse: meshes[1]! };
}

/** From where all cells of the cut are leaves and none is near. */
const AFAR = { near: 0.01, eye: [2, -5, 0.5] as Vector3, farGeometry: true };
const plan = (root: Cell, changes = {}): Plan => makePlan([root], DIRECTIONS, view({ ...AFAR, ...changes }));
/** Leaves of which instances are drawn, and in which form. */
const drawn = ({ instances }: Plan): string[] => instances.map(({ placed, form }) => `${placed.corner.join()} ${"level" in form ? form.level : form.mesh.key}`);

const resource = (key = "mesh/1"): Resource => new Resource(key, "mesh", 10, null);

describe("placedMesh", () => {
  it("places a mesh that is turned, mirrored and made larger where its leaf is", () => {
    // x to y twice as large, y to -x, z mirrored.
    const turned = [0, -1, 0, 10, 2, 0, 0, 20, 0, 0, -1, 30];
    const listed = { ...STATUE, bounds: [[1, 2, 3], [2, 4, 6]] as const, objects: [5, 6], transforms: [turned, STATUE.transforms[0]!] };
    const { instances, bounds, corner } = placedMesh(listed, [100, 200, 300], { forms: [meshForm(STATUE.levels[0]!, 0, resource())], impostors: [] });
    expect([...instances[0]!.transform]).toEqual([0, 2, 0, 0, -1, 0, 0, 0, 0, 0, -1, 0, 10, 20, 30, 1]);
    expect(instances[0]!.bounds).toEqual({ lower: [106, 222, 324], upper: [108, 224, 327] });
    expect(instances[1]).toMatchObject({ object: 6, bounds: { lower: [101.5, 202.5, 303], upper: [102.5, 204.5, 306] } });
    expect(bounds).toEqual({ lower: [101.5, 202.5, 303], upper: [108, 224, 327] });
    expect(corner).toEqual([100, 200, 300]);
  });

  it("tells how good each form is, and what it needs besides", () => {
    const { cells, full, coarse } = statues();
    const [first, other] = cells.get("0/0/0/0")!.instances[0]!.forms;
    expect(first).toMatchObject({ level: 0, told: [0, 0, 0] });
    expect([...first!.images]).toEqual([[hash(7), 5000]]);
    expect(other).toMatchObject({ level: 1, told: [0.2, 0.4, 0.4] });
    expect([4, 2, 1].map((width) => errorAt(other!, 1, width, MESH_FARTHEST))).toEqual([0.2, 0.3, 0.4].map((error) => expect.closeTo(error)));
    expect(full).toMatchObject({ key: `mesh/${hash(1)}`, kind: "mesh", bytes: 900, cell: null });
    // Who asks for one knows the images that it needs.
    expect([...full.images.keys()]).toEqual([hash(7)]);
    expect(coarse.images.size).toBe(0);
    expect(cells.get("0/3/1/0")!.instances[0]!.forms[0]!.mesh).toBe(full);
  });

  it("finds the finest form that is there, and those that are on their way to be finer", () => {
    const forms: MeshForm[] = ["a", "b", "c", "d"].map((key, level) => meshForm(STATUE.levels[0]!, level, resource(key)));
    const levels = (): number[] => comingMeshes(forms).map(({ level }) => level);
    expect(heldMesh(forms)).toBeNull();
    expect(levels()).toEqual([]);
    forms[1]!.mesh.state = "loading";
    forms[3]!.mesh.state = "fetched";
    expect(levels()).toEqual([1, 3]);
    hold([forms[2]!.mesh]);
    forms[0]!.mesh.state = "bad";
    expect(levels()).toEqual([1]);
    expect(heldMesh(forms)).toBe(forms[2]);
    hold([forms[0]!.mesh]);
    expect(levels()).toEqual([]);
  });
});

describe("instances below a cell", () => {
  it("are those of all its leaves", () => {
    const { root, cells } = statues();
    expect(instancesBelow(root)).toHaveLength(16);
    expect(instancesBelow(root)).toBe(instancesBelow(root));
    const west = instancesBelow(cells.get("1/0/0/0")!);
    expect(west.map(({ corner }) => corner)).toEqual([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]].sort());
    expect([...meshesBelow(cells.get("1/0/0/0")!)]).toEqual([[west[0]!.forms, west]]);
    expect(boundsOfInstances(cells.get("1/0/0/0")!)).toEqual({ lower: [0.4, 0.4, 0], upper: [1.6, 1.6, 0.5] });
  });

  it("are none where there are none, or not all leaves are known or have geometry", () => {
    expect(boundsOfInstances(makeWorld().root)).toBeNull();
    const { root, cells } = statues();
    const leaf = cells.get("0/3/3/0")!;
    const { children } = leaf.parent!;
    leaf.parent!.children = null;
    expect(instancesBelow(root)).toEqual([]);
    leaf.parent!.children = children;
    leaf.forms = [];
    expect(instancesBelow(root)).toEqual([]);
    expect(instancesBelow(cells.get("1/0/0/0")!)).toHaveLength(4);
  });

  it("are not told of what is no leaf, and not placed nowhere", () => {
    const { root, cells } = statues({ instances: [STATUE, { ...STATUE, objects: [], transforms: [] }] });
    expect(root.instances).toEqual([]);
    expect(cells.get("0/0/0/0")!.instances).toHaveLength(1);
  });

  it("stay the same ones in a newer generation that has the same index", () => {
    const entry = { key: "0/0/0/0", bounds: [[0, 0, 0], [1, 1, 1]], error: 1, instances: [STATUE], geometry: { hash: hash(3), bytes: 5, meshes: [] } };
    const key = { level: 0, x: 0, y: 0, z: 0 };
    const first = new Cell(key, null, GRID);
    first.startsTile(hash(4));
    first.read(new Map([[entry.key, entry as unknown as CellEntry]]), new SharedMeshes(), "test");
    const second = new Cell(key, null, GRID, first);
    second.startsTile(hash(4));
    expect(second.instances).toHaveLength(1);
    expect(second.instances).toBe(first.instances);
    expect(instancesBelow(second)).toEqual(instancesBelow(first));
  });
});

describe("makePlan", () => {
  it("draws instances by the finest form that is there, beside what stands in for their cells", () => {
    const { root, full, coarse } = statues();
    hold(tilesOf(root));
    const [nothing, something, everything] = [plan(root), (hold([coarse]), plan(root)), (hold([full]), plan(root))];
    expect(drawn(nothing)).toEqual([]);
    expect(drawn(something)).toHaveLength(16);
    expect(drawn(something)).toContain("3,1,0 1");
    expect(drawn(everything)).toContain("3,1,0 0");
    expect(something.pictures.map(({ cell }) => cell)).toEqual([root]);
    // The coarse picture of a statue must not hide it.
    expect([nothing, something].map(({ pictures }) => pictures[0]!.behind)).toEqual([false, true]);
    expect([samePlan(nothing, something), samePlan(something, everything), samePlan(something, something)]).toEqual([false, false, true]);
  });

  it("draws no more triangles of a cell that is far away than a picture of it has pixels", () => {
    const far = { eye: [2, -300, 0.5] as Vector3, radius: 100 };
    const { root, full, coarse } = statues();
    expect([...root.children!].map((cell) => finestAfar(cell, GRID.resolution))).toEqual([1, 1, 1, 1]);
    hold([full]);
    expect(drawn(plan(root, far))).toEqual([]);
    hold([coarse]);
    expect(drawn(plan(root, far))).toHaveLength(16);
    expect(new Set(drawn(plan(root, far)).map((name) => name.split(" ")[1]))).toEqual(new Set(["1"]));
    const dense = statues({ instances: [{ ...STATUE, levels: STATUE.levels.map((level) => ({ ...level, triangles: 1000 * level.triangles })) }] });
    hold([dense.full, dense.coarse]);
    expect(finestAfar(dense.root, GRID.resolution)).toBe(Infinity);
    expect(drawn(plan(dense.root))).toEqual([]);
  });

  it("draws what reaches out of leaves that are geometry whole, until those that it reaches into are, too", () => {
    const transforms = [[1, 0, 0, 0.95, 0, 1, 0, 0.5, 0, 0, 1, 0]];
    const { root, cells, full } = statues({ instances: [{ ...STATUE, transforms }] });
    const near = { near: 1.1, eye: [0.5, -1, 0.5] as Vector3 };
    hold([full, cells.get("0/0/0/0")!.geometry!.leaf]);
    expect(plan(root, near).geometry.map(({ leaf }) => leaf.cell!.name)).toEqual(["0/0/0/0"]);
    expect(drawn(plan(root, near))).toContain("0,0,0 0");
    hold([cells.get("0/1/0/0")!.geometry!.leaf]);
    expect(plan(root, near).geometry.map(({ leaf }) => leaf.cell!.name).sort()).toEqual(["0/0/0/0", "0/1/0/0"]);
    expect(drawn(plan(root, near))).not.toContain("0,0,0 0");
  });

  it("leaves out of what reaches into leaves that are left out what is there", () => {
    const transforms = [[1, 0, 0, -0.05, 0, 1, 0, 0.5, 0, 0, 1, 0]];
    const { root, cells, full } = statues({ instances: [{ ...STATUE, transforms }] });
    const near = { near: 1.1, eye: [0.5, -1, 0.5] as Vector3, farOnly: true };
    hold([full]);
    expect(drawn(plan(root, near))).toContain("1,0,0 0");
    // By its leaf what of it is there.
    hold([cells.get("0/1/0/0")!.geometry!.leaf]);
    expect(plan(root, near).geometry.map(({ leaf }) => leaf.cell!.name)).toEqual(["0/1/0/0"]);
    expect(drawn(plan(root, near))).not.toContain("1,0,0 0");
  });

  it("draws none where geometry is not wanted", () => {
    const { root, coarse } = statues();
    hold([coarse]);
    for (const changes of [{ farGeometry: false }, { near: 0 }]) expect(drawn(plan(root, changes))).toEqual([]);
    expect(drawn(plan(root, { farOnly: true, near: 1e3 }))).toEqual([]);
    expect(drawn(plan(root, { farOnly: true }))).toEqual(drawn(plan(root)));
  });

  it("draws what reaches out of leaves that are left out, whatever there is of these", () => {
    const transforms = [[1, 0, 0, 0.95, 0, 1, 0, 0.5, 0, 0, 1, 0]];
    const { root, cells, coarse } = statues({ instances: [{ ...STATUE, transforms }] });
    const near = { near: 1.1, eye: [0.2, -0.9, 0.5] as Vector3, farOnly: true };
    hold([coarse, ...tilesOf(cells.get("0/0/0/0")!)]);
    expect(drawn(plan(root, near))).toContain("0,0,0 1");
    expect(drawn(plan(root, { ...near, near: 2 }))).not.toContain("0,0,0 1");
    expect(drawn(plan(root, { ...near, farGeometry: false }))).toEqual([]);
  });

  it("draws none of cells that are there: by pictures, as geometry, or by what is finer", () => {
    const { root, cells, coarse } = statues();
    hold([coarse]);
    hold(tilesOf(cells.get("0/0/0/0")!));
    hold(tilesOf(cells.get("0/1/0/0")!).slice(0, 1));
    hold([cells.get("0/2/0/0")!.geometry!.leaf]);
    expect(drawn(plan(root)).filter((name) => name.includes(",0,0 "))).toEqual(["1,0,0 1", "3,0,0 1"]);
    // The cells of the cut are those of level 1: in the west two leaves are still to come, in the east all four are there.
    const far = { eye: [2, -300, 0.5] as Vector3, radius: 100 };
    for (const [name, cell] of cells) if (/^0\/[23]/.test(name)) hold(tilesOf(cell));
    const corners = drawn(plan(root, far)).map((name) => Number(name.split(",")[0]));
    expect(new Set(corners)).toEqual(new Set([0, 1]));
  });

  it("draws none that shows less than pictures that are there in part, or those of cells above", () => {
    const [full, coarse] = STATUE.levels as [InstancedMesh["levels"][number], InstancedMesh["levels"][number]];
    // One of two tiles shows nine tenths.
    const picks: number[][] = new Array<number[]>(26).fill([0, 32, 1, 13]);
    const fine = { picks };
    const poor = { picks, instances: [{ ...STATUE, levels: [full, { ...coarse, errors: [240, 240, 240] }] }] };
    const of = (changes: Partial<CellEntry>, held: (world: ReturnType<typeof statues>) => Resource[]): boolean => {
      const world = statues(changes);
      hold([world.coarse, ...held(world)]);
      return drawn(plan(world.root)).includes("1,0,0 1");
    };
    const parts = (count: number) => ({ cells }: ReturnType<typeof statues>): Resource[] => tilesOf(cells.get("0/1/0/0")!).slice(0, count);
    expect([0, 1].map((count) => of(poor, parts(count)))).toEqual([true, false]);
    expect([0, 1].map((count) => of(fine, parts(count)))).toEqual([true, true]);
    // Those of a cell above are not as sharp.
    expect(of(poor, ({ root }) => tilesOf(root.children![0]!))).toBe(false);
    expect(of(poor, ({ root }) => tilesOf(root))).toBe(true);
  });

  it("draws those of a near leaf until its geometry is there, whatever stands in for it", () => {
    const { root, cells, coarse } = statues();
    const near = { near: 0.1, eye: [2.5, 2.5, 0.5] as Vector3, farGeometry: false };
    const leaf = cells.get("0/2/2/0")!;
    hold([coarse, ...tilesOf(leaf)]);
    expect(drawn(plan(root, near))).toEqual(["2,2,0 1"]);
    hold([leaf.geometry!.leaf]);
    expect(drawn(plan(root, near))).toEqual([]);
    expect(plan(root, near).geometry).toEqual([leaf.geometry]);
  });

  it("draws what reaches into the picture from beside it", () => {
    const wide = { ...STATUE, bounds: [[-0.1, -0.1, 0], [0.9, 0.1, 0.5]] as const };
    const { root, cells, coarse } = statues({ instances: [wide] });
    hold([coarse]);
    // East of x = 2.3: leaves, with room for splats, begin there at x = 1 no more.
    const frustum = [{ normal: [1, 0, 0] as const, offset: -2.3 }];
    const seen = new Set(drawn(plan(root, { frustum })).map((name) => name[0]));
    expect(seen).toEqual(new Set(["1", "2", "3"]));
    for (const y of [0, 1, 2, 3]) hold([cells.get(`0/1/${y}/0`)!.geometry!.leaf]);
    expect(new Set(drawn(plan(root, { frustum })).map((name) => name[0]))).toEqual(new Set(["2", "3"]));
  });
});

describe("listWants", () => {
  const wanted = (root: Cell, changes = {}): Map<Resource, number> => {
    const seen = view({ ...AFAR, ...changes });
    return new Map(listWants([root], makePlan([root], DIRECTIONS, seen), MANIFEST, seen).map((want) => [want.resource, want.urgency]));
  };

  it("wants what comes of instances until their cells are there, and asks for none", () => {
    const { root, cells, full, coarse } = statues();
    expect(wanted(root).has(coarse)).toBe(false);
    coarse.state = full.state = "loading";
    expect([wanted(root).get(coarse), wanted(root).get(full)]).toEqual([URGENCY.seen, URGENCY.seen]);
    expect(wanted(root, { farGeometry: false }).has(full)).toBe(false);
    hold([full]);
    expect(wanted(root).has(coarse)).toBe(false);
    full.state = "ready";
    for (const cell of cells.values()) hold(tilesOf(cell));
    expect(wanted(root).has(full)).toBe(false);
    const near = { near: 0.1, eye: [2.5, 2.5, 0.5] as Vector3, farGeometry: false };
    expect(wanted(root, near).get(full)).toBe(URGENCY.seen);
    hold([cells.get("0/2/2/0")!.geometry!.leaf]);
    expect(wanted(root, near).has(full)).toBe(false);
  });
});

describe("outsideOf", () => {
  const box = { lower: [0.5, 0.5, 0], upper: [1.5, 1.25, 2] } as Box;
  it("is the box around what reaches out of leaves that are left out", () => {
    expect(outsideOf(box, [10, 10, 10], 1, () => false)).toEqual(box);
    expect(outsideOf(box, [10, 10, 10], 1, () => true)).toBeNull();
    expect(outsideOf(box, [10, 10, 10], 1, ({ lower }) => lower[0] < 1)).toEqual({ lower: [1, 0.5, 0], upper: [1.5, 1.25, 2] });
    expect(outsideOf(box, [0, 0, 0], 1, ({ upper }) => upper[1] < 2)).toEqual({ lower: [0.5, 1, 0], upper: [1.5, 1.25, 2] });
    expect(outsideOf({ lower: [1, 1, 1], upper: [1, 1, 1] }, [0, 0, 0], 1, ({ lower }) => lower[0] < 1)).toEqual({ lower: [1, 1, 1], upper: [1, 1, 1] });
  });
});
