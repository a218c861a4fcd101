import { describe, expect, it } from "vitest";
import type { Cell } from "../src/core/cell.js";
import { viewBin } from "../src/core/directions.js";
import { COVERED, HOLE, HoleTable } from "../src/core/holes.js";
import { makePlan, type Plan } from "../src/core/plan.js";
import { Resource } from "../src/core/resource.js";
import type { Vector3 } from "../src/core/vector.js";
import { tilesWanted } from "../src/core/views.js";
import { listWants, URGENCY } from "../src/core/wants.js";
import { DIRECTIONS, hold, makeWorld, MANIFEST, tilesOf, view } from "./worlds.js";

const drawn = (plan: Plan): string[] => plan.pictures.map(({ cell }) => cell.name);
const plan = (root: Parameters<typeof makePlan>[0][number], changes = {}): Plan => makePlan([root], DIRECTIONS, view(changes));

describe("makePlan", () => {
  it("draws nothing while nothing is held", () => {
    expect(drawn(plan(makeWorld().root))).toEqual([]);
  });

  it("lets the root stand in for everything", () => {
    const { root } = makeWorld();
    hold(tilesOf(root));
    const [draw, ...others] = plan(root).pictures;
    expect(others).toEqual([]);
    expect(draw).toMatchObject({ cell: root, holes: HOLE });
    expect(draw!.tiles.map(({ key }) => key.split("/")[5])).toEqual(["4", "14"]);
  });

  it("draws each cell of the cut once all its wanted views are there, and the root in the holes between", () => {
    const { root, cells } = makeWorld();
    hold(tilesOf(root));
    hold(tilesOf(cells.get("0/0/0/0")!));
    hold(tilesOf(cells.get("0/3/1/0")!).slice(0, 1));
    const found = plan(root);
    expect(drawn(found)).toEqual(["0/0/0/0", "0/3/1/0", "2/0/0/0"]);
    expect(found.standIns).toBe(1);
    // Octants: bit 0 is x, bit 1 is y. Of the lower left quarter all but its own lower left is a hole.
    expect(found.pictures[2]!.holes).toEqual([[COVERED, HOLE, HOLE, HOLE, 0, 0, 0, 0], HOLE, HOLE, HOLE, 0, 0, 0, 0]);
  });

  it("lets the nearest ancestor that is held stand in", () => {
    const { root, cells } = makeWorld();
    for (const name of ["2/0/0/0", "1/1/1/0", "0/3/3/0"]) hold(tilesOf(cells.get(name)!));
    const found = plan(root);
    expect(drawn(found)).toEqual(["0/3/3/0", "1/1/1/0", "2/0/0/0"]);
    expect(found.pictures[1]!.holes).toEqual([HOLE, HOLE, HOLE, COVERED, 0, 0, 0, 0]);
    expect(found.pictures[2]!.holes).toEqual([HOLE, HOLE, HOLE, COVERED, 0, 0, 0, 0]);
  });

  describe("what is farther away than near", () => {
    const afar = { near: 0.1, radius: 2, eye: [2, -5, 0.5] as Vector3, farGeometry: true };
    const leavesBelow = (cell: Cell): Cell[] => (cell.level === 0 ? [cell] : cell.children!.flatMap(leavesBelow));

    it("is geometry as far as leaves are there, and once all are wants no pictures", () => {
      const { root, cells } = makeWorld();
      const [west, east] = [cells.get("1/0/0/0")!, cells.get("1/1/0/0")!];
      hold(tilesOf(root));
      const [first, ...others] = leavesBelow(west).map(({ geometry }) => geometry!.leaf);
      hold([first!]);
      expect([...plan(root, afar).afar].map(({ name }) => name)).toEqual(["0/0/0/0"]);
      hold(others);
      const found = plan(root, afar);
      expect([...found.afar]).toEqual([west]);
      expect(found.geometry).toHaveLength(4);
      expect(found.cut.pictures).toContain(east);
      const wanted = listWants([root], found, MANIFEST, view(afar)).map(({ resource }) => resource.cell);
      expect(wanted).toContain(east);
      expect(wanted.filter((cell) => cell === west)).toEqual([]);
      expect(plan(root, { ...afar, farGeometry: false }).afar.size).toBe(0);
      expect(plan(root, { ...afar, near: 0 }).afar.size).toBe(0);
    });

    it("is drawn from its pictures where they show more", () => {
      const { root, cells } = makeWorld();
      const west = cells.get("1/0/0/0")!;
      for (const leaf of leavesBelow(west)) {
        const entry = { ...leaf.geometry!.entry, errors: [128, 128, 128] };
        leaf.forms = [leaf.geometry!, { ...leaf.geometry!, entry, level: 1, leaf: new Resource(`geometry/${leaf.name}-12`, "geometry", 100, leaf) }];
      }
      hold(leavesBelow(west).map(({ forms }) => forms[1]!.leaf));
      expect([...plan(root, afar).afar]).toEqual([west]);
      hold(tilesOf(west));
      expect([...plan(root, afar).afar]).toEqual([]);
      hold(leavesBelow(west).map(({ forms }) => forms[0]!.leaf));
      expect([...plan(root, afar).afar]).toEqual([west]);
    });
  });

  it("draws a near leaf by the finest of its forms that is there", () => {
    const { root, cells } = makeWorld();
    const leaf = cells.get("0/0/0/0")!;
    const coarse = { ...leaf.geometry!, level: 1, leaf: new Resource("geometry/0/0/0/0-12", "geometry", 100, leaf) };
    leaf.forms = [leaf.geometry!, coarse];
    const levels = (): number[] => plan(root, { near: 1 }).geometry.map(({ level }) => level);
    expect(levels()).toEqual([]);
    hold([coarse.leaf]);
    expect(levels()).toEqual([1]);
    hold([leaf.geometry!.leaf]);
    expect(levels()).toEqual([0]);
  });

  it("keeps finer cells until the coarser one has come", () => {
    const { root, cells } = makeWorld();
    const leaves = [...cells.values()].filter(({ level }) => level === 0);
    for (const leaf of leaves) hold(tilesOf(leaf));
    const far = { eye: [2, 2, 500], radius: 1 };
    expect(drawn(plan(root, far))).toHaveLength(16);
    hold(tilesOf(root));
    expect(drawn(plan(root, far))).toEqual(["2/0/0/0"]);
  });

  it("keeps old tiles until the new ones have come", () => {
    const { root } = makeWorld();
    const [a, b, c] = tilesOf(root);
    const far = (views: number) => ({ eye: [2, 2, 500], radius: 1, choice: { views, leastGain: 10, layers: 1 } });
    hold([a!]);
    expect(plan(root, far(1)).pictures[0]!.tiles).toEqual([a]);
    hold([c!]);
    expect(plan(root, far(3)).pictures[0]!.tiles).toEqual([a, c]);
    hold([b!]);
    expect(plan(root, far(3)).pictures[0]!.tiles).toEqual([a, b, c]);
  });

  it("draws what has come of a cell before what stands in for it", () => {
    const { root, cells } = makeWorld();
    const leaf = cells.get("0/0/0/0")!;
    const wanted = (cell: typeof leaf) => tilesOf(cell).slice(0, 2);
    hold(wanted(leaf).slice(0, 1));
    expect(plan(root).pictures).toMatchObject([{ cell: leaf, share: 0.5, behind: false }]);
    hold(wanted(root).slice(0, 1));
    expect(plan(root).pictures).toMatchObject([
      { cell: leaf, share: 0.5 },
      { cell: root, holes: HOLE, share: 0.5, behind: true },
    ]);
    hold(wanted(root));
    expect(plan(root).pictures).toMatchObject([{ cell: leaf }, { cell: root, holes: HOLE, share: 1, behind: true }]);
    hold(wanted(leaf));
    expect(plan(root).pictures).toMatchObject([
      { cell: leaf, share: 1, behind: false },
      { cell: root, behind: false },
    ]);
  });

  it("keeps parts of a cell while others are wanted of it", () => {
    const { root } = makeWorld();
    const [a, b, c] = tilesOf(root);
    const far = (views: number) => ({ eye: [2, 2, 500], radius: 1, choice: { views, leastGain: 10, layers: 1 } });
    hold([a!, c!]);
    expect(plan(root, far(4)).pictures[0]!.tiles).toEqual([a, c]);
    expect(plan(root, far(2)).pictures[0]!.tiles).toEqual([a, c]);
    a!.state = "absent";
    expect(plan(root, far(2)).pictures[0]!.tiles).toEqual([c]);
    hold([a!, b!]);
    expect(plan(root, far(2)).pictures[0]!.tiles).toEqual([a, b]);
  });

  it("draws near leaves as geometry when it is there, else from pictures", () => {
    const { root, cells } = makeWorld();
    const near = { near: 0.1 };
    const leaf = cells.get("0/2/2/0")!;
    hold(tilesOf(leaf));
    expect(drawn(plan(root, near))).toEqual(["0/2/2/0"]);
    hold([leaf.geometry!.leaf]);
    const found = plan(root, near);
    expect(drawn(found)).toEqual([]);
    expect(found.geometry).toEqual([leaf.geometry]);
    expect(plan(root, { ...near, farOnly: true }).geometry).toEqual([]);
  });

  it("leaves out what is outside the frustum", () => {
    const { root, cells } = makeWorld();
    for (const cell of cells.values()) hold(tilesOf(cell));
    // East of x = 2.5 (a splat may reach 4 pitches, 0.25 m, beyond its cell).
    const frustum = [{ normal: [1, 0, 0], offset: -2.5 }];
    expect(drawn(plan(root, { frustum }))).toHaveLength(8);
  });

  it("lets an ancestor fill the gaps of a cell that has some of its tiles, and whose index has not been read", () => {
    const { root, cells } = makeWorld();
    hold(tilesOf(root));
    const cell = cells.get("1/0/0/0")!;
    hold(tilesOf(cell).slice(0, 1));
    cell.children = null;
    const found = plan(root);
    expect(drawn(found)).toEqual(["1/0/0/0", "2/0/0/0"]);
    expect(found.pictures[0]!.holes).toBe(HOLE);
  });

  it("draws a root with a bad tile from what there is", () => {
    const { root } = makeWorld();
    const far = { eye: [2, 2, 500], radius: 1 };
    const [first, ...others] = tilesOf(root);
    hold(others.slice(0, 1));
    first!.state = "bad";
    expect(plan(root, far).pictures[0]).toMatchObject({ cell: root, holes: HOLE });
  });
});

describe("listWants", () => {
  it("wants the root first, then what is seen from near to far, then what stands in, then the rest", () => {
    const { root } = makeWorld();
    const seen = view({ eye: [0.1, 0.1, 0.5], frustum: [{ normal: [-1, 0, 0], offset: 1.5 }] });
    const wants = listWants([root], makePlan([root], DIRECTIONS, seen), MANIFEST, seen);
    expect(wants.slice(0, 2).every(({ resource }) => resource.cell === root)).toBe(true);
    const urgencies = wants.map(({ urgency }) => urgency);
    expect(urgencies).toEqual([...urgencies].sort());
    const distances = wants.filter(({ urgency }) => urgency === URGENCY.seen).map(({ distance }) => distance);
    expect(distances).toEqual([...distances].sort((a, b) => a - b));
    expect(distances).toHaveLength(2 * 8);
  });

  it("wants the parent of a cell with a bad tile", () => {
    const { root, cells } = makeWorld();
    tilesOf(cells.get("0/0/0/0")!)[1]!.state = "bad";
    const everything = view();
    const wants = listWants([root], makePlan([root], DIRECTIONS, everything), MANIFEST, everything);
    const parents = wants.filter(({ resource, urgency }) => urgency === URGENCY.seen && resource.cell?.name === "1/0/0/0");
    expect(parents).toHaveLength(2);
  });
});

describe("tilesWanted", () => {
  const eye: Vector3 = [2, 2, 500];
  const ABOVE = viewBin([2, 2, 0.5], eye);
  const picks: number[][] = new Array<number[]>(26).fill([]).with(ABOVE, [2, 32, 0, 13, 1, 20]);
  const { root } = makeWorld({ picks });
  const [first, second, third] = tilesOf(root);
  const wanted = (views: number | null, leastGain: number, layers = 2) => tilesWanted(root, DIRECTIONS, eye, { views, leastGain, layers });

  it("takes what adds enough for its bytes", () => {
    expect(root.picks[ABOVE]!.map(({ gain }) => Math.round(gain))).toEqual([256, 27, 1]);
    expect(wanted(null, 20)).toEqual([third, first]);
    expect(wanted(null, 0)).toEqual([third, first, second]);
  });

  it("takes the best at any price", () => {
    expect(wanted(null, 1e6)).toEqual([third]);
  });

  it("takes a number of directions when told", () => {
    expect(wanted(2, 10)).toEqual([first, second]);
    expect(tilesWanted(makeWorld().root, DIRECTIONS, eye, { views: null, leastGain: 10, layers: 2 })).toHaveLength(3);
  });
});

describe("HoleTable", () => {
  it("writes nodes of eight words", () => {
    const table = new HoleTable();
    expect(table.add(HOLE)).toBe(HOLE);
    const place = table.add([HOLE, COVERED, [COVERED, HOLE, 0, 0, 0, 0, 0, 0], 0, 0, 0, 0, 0]);
    expect(place).toBe(8);
    expect(table.words.slice(8, 24)).toEqual([HOLE, COVERED, 16, 0, 0, 0, 0, 0, COVERED, HOLE, 0, 0, 0, 0, 0, 0]);
  });
});
