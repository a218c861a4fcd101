import { describe, expect, it } from "vitest";
import type { Cell } from "../src/core/cell.js";
import { makePlan, type PlanView } from "../src/core/plan.js";
import type { Projection } from "../src/core/projection.js";
import { Resource } from "../src/core/resource.js";
import { Sizes } from "../src/core/sizes.js";
import { Link } from "../src/core/stream/link.js";
import { Observer } from "../src/core/stream/observer.js";
import { Ranking, type RankedView } from "../src/core/stream/ranking.js";
import type { Vector3 } from "../src/core/vector.js";
import { isNeeded, listWants, URGENCY, type Want } from "../src/core/wants.js";
import { DIRECTIONS, hold, makeWorld, MANIFEST, tilesOf, view } from "./worlds.js";

const BUDGET = 1e9;
const SHOT = { toX: [1, 0, 0], toY: [0, 0, 1], toW: [0, 1, 0], near: 0.01, width: 200, height: 200, focal: 100 } as const;
const EYE: Vector3 = [2, -1, 0.5];

function looking(eye: Vector3, toW: Vector3 = [0, 1, 0]): Projection & { focal: number } {
  return { ...SHOT, eye, toW };
}

/** Ranks what a viewer that looks north, from EYE if nothing else is said, wants of a world, after `seconds`. */
function ranked(ranking: Ranking, root: Cell, changes: Partial<PlanView> = {}, budget = BUDGET, seconds = 0): Want[] {
  const seen = view({ eye: EYE, radius: 100, ...changes });
  const wants = listWants([root], makePlan([root], DIRECTIONS, seen), MANIFEST, seen);
  const cells: RankedView = { ...seen, roots: [root], directions: DIRECTIONS, holdsImage: () => true, lacks: () => false };
  return ranking.rank(wants, cells, new Observer().see(looking(seen.eye), seconds, 1), budget);
}

const names = (wants: readonly Want[]): string[] => [...new Set(wants.map(({ resource }) => resource.cell!.name))];

describe("Ranking", () => {
  it("brings an outline of everything first where that shows most of it, then what is large in the picture", () => {
    const { root } = makeWorld({ losses: [5, 5, 5, 5] });
    const order = names(ranked(new Ranking(new Link(), new Sizes()), root).filter(({ rank }) => rank !== undefined));
    expect(order[0]).toBe(root.name);
    const [near, far] = ["0/1/0/0", "0/1/3/0"].map((name) => order.indexOf(name));
    expect(near).toBeGreaterThan(-1);
    expect(near).toBeLessThan(far!);
  });

  it("leaves out what would come when it is needed no more", () => {
    const { root, cells } = makeWorld();
    const ranking = new Ranking(new Link(), new Sizes());
    const between = (wants: Want[]) => wants.filter(({ resource, urgency }) => resource.cell?.level === 1 && isNeeded(urgency));
    expect(between(ranked(ranking, root))).not.toEqual([]);
    for (const cell of cells.values()) if (cell.level === 0) hold(tilesOf(cell));
    expect(between(ranked(ranking, root, {}, BUDGET, 1))).toEqual([]);
  });

  it("makes a new order as soon as all of one has come", () => {
    const { root, cells } = makeWorld();
    const ranking = new Ranking(new Link(), new Sizes());
    const late = tilesOf(cells.get("0/1/0/0")!);
    hold(late);
    const first = ranked(ranking, root).filter(({ rank }) => rank !== undefined);
    expect(first.map(({ resource }) => resource)).not.toContain(late[0]);
    // What is dropped meanwhile has its place in no order yet: not at once, but when all else is there.
    for (const tile of late) tile.state = "absent";
    const rankOf = () => ranked(ranking, root).find(({ resource }) => resource === late[0])!.rank;
    expect(rankOf()).toBeUndefined();
    hold(first.map(({ resource }) => resource));
    expect(rankOf()).toBeDefined();
  });

  it("goes on to want what is under way", () => {
    const { root } = makeWorld();
    const ranking = new Ranking(new Link(), new Sizes());
    const between = ranked(ranking, root).find(({ resource, rank }) => resource.cell?.level === 1 && rank !== undefined)!.resource;
    between.state = "loading";
    expect(ranked(ranking, root, {}, BUDGET, 1).map(({ resource }) => resource)).toContain(between);
    const elsewhere = [{ normal: [0, -1, 0] as Vector3, offset: -5 }];
    expect(ranked(ranking, root, { frustum: elsewhere }, BUDGET, 2).some(({ resource, urgency }) => resource === between && isNeeded(urgency))).toBe(false);
  });

  it("wants what a server has sent, unless what is there shows it better", () => {
    const { root, cells } = makeWorld();
    const leaf = cells.get("0/0/0/0")!;
    const coarse = { ...leaf.geometry!, level: 1, leaf: new Resource("geometry/0/0/0/0-12", "geometry", 100, leaf) };
    leaf.forms = [leaf.geometry!, coarse];
    const wanted = (seconds: number): boolean =>
      ranked(new Ranking(new Link(), new Sizes()), root, { near: 50 }, BUDGET, seconds).some(({ resource, urgency }) => resource === coarse.leaf && isNeeded(urgency));
    coarse.leaf.state = "fetched";
    expect(wanted(0)).toBe(true);
    hold([leaf.geometry!.leaf]);
    expect(wanted(0)).toBe(false);
  });

  it("asks about leaves below what is seen, where they may show enough more", () => {
    const shape = { radius: 6, near: 0.1, farGeometry: true, eye: [2, -20, 0.5] as const };
    const unknown = (errors: number[]): string[] => {
      const { root, cells } = makeWorld({ errors });
      const coarse = [...cells.values()].filter(({ level }) => level === 1);
      for (const cell of coarse) Object.assign(cell, { children: null, indexHash: "ab" });
      const ranking = new Ranking(new Link(), new Sizes());
      ranked(ranking, root, shape);
      expect(ranking.unknown).toEqual([]);
      for (const cell of coarse) hold(tilesOf(cell));
      ranked(ranking, root, shape, BUDGET, 1);
      return ranking.unknown.map(({ name }) => name);
    };
    expect(unknown([100, 100, 100]).sort()).toEqual(["1/0/0/0", "1/0/1/0", "1/1/0/0", "1/1/1/0"]);
    expect(unknown([1, 1, 1])).toEqual([]);
  });

  it("keeps its order for a tenth of a second", () => {
    const { root } = makeWorld({ losses: [5, 5, 5, 5] });
    const ranking = new Ranking(new Link(), new Sizes());
    const first = ranked(ranking, root).map(({ resource }) => resource.key);
    expect(ranked(ranking, root, {}, BUDGET, 0.05).map(({ resource }) => resource.key)).toEqual(first);
    const come = first.slice(0, 3);
    hold([...root.views.values()].flatMap(({ layers }) => layers).filter(({ key }) => come.includes(key)));
    const next = ranked(ranking, root, {}, BUDGET, 0.2).filter(({ rank }) => rank !== undefined).map(({ resource }) => resource.key);
    expect(next).not.toContain(come[0]);
  });

  it("asks for nothing that stands in where that and the picture would not fit together", () => {
    const { root } = makeWorld();
    const wants = ranked(new Ranking(new Link(), new Sizes()), root, {}, 1);
    expect(wants.filter(({ resource, urgency }) => resource.cell!.level === 1 && isNeeded(urgency))).toEqual([]);
    expect(wants.filter(({ urgency }) => urgency === URGENCY.seen).length).toBeGreaterThan(0);
  });
});

describe("Link", () => {
  it("is as fast as what comes while something is under way", () => {
    const link = new Link(0);
    expect(link.bandwidth).toBe(20_000);
    for (let n = 0; n < 20; n++) {
      link.sent(n / 10, 1000);
      link.acknowledged(n / 10 + 0.1, 1000);
    }
    expect(link.bandwidth / 10_000).toBeCloseTo(1, 1);
    for (let n = 0; n < 40; n++) {
      link.sent(100 + n / 10, 5000);
      link.acknowledged(100 + n / 10 + 0.1, 5000);
    }
    expect(link.bandwidth / 50_000).toBeCloseTo(1, 1);
    const before = link.bandwidth;
    link.acknowledged(200, 1e9);
    expect(link.bandwidth).toBe(before);
    link.sent(201, 300);
    link.givenUp(300);
    expect(link.underWay).toBe(0);
  });

  it("forgets that nothing came for long once something comes", () => {
    const link = new Link();
    link.sent(0, 100_000);
    for (let n = 1; n <= 5; n++) link.acknowledged(0.1 + n / 10, 10_000);
    expect(link.bandwidth / 100_000).toBeCloseTo(1, 1);
    for (let n = 0; n < 5; n++) link.acknowledged(10.6 + n / 10, 10_000);
    expect(link.bandwidth / 100_000).toBeCloseTo(1, 1);
  });
});

describe("Observer", () => {
  it("tells how a viewer moves", () => {
    const observer = new Observer();
    let seen = observer.see(looking([0, 0, 0]), 0, 10);
    expect(seen.velocity).toEqual([0, 0, 0]);
    for (let n = 1; n <= 20; n++) seen = observer.see(looking([0.5 * n, 0, 0]), 0.1 * n, 10);
    expect(seen.velocity[0]).toBeCloseTo(5, 3);
    expect(seen.acceleration[0]).toBeCloseTo(0, 1);
    expect(observer.see(looking([10, 0, 0]), 4, 10).velocity).toEqual([0, 0, 0]);
  });

  it("tells how a viewer turns, across north too, and when it rests", () => {
    const observer = new Observer();
    const at = (angle: number): Vector3 => [Math.cos(angle), Math.sin(angle), 0];
    let seen = observer.see(looking([0, 0, 0], at(3)), 0, 10);
    for (let n = 1; n <= 20; n++) seen = observer.see(looking([0, 0, 0], at(3 + 0.02 * n)), 0.1 * n, 10);
    expect(seen.turning).toBeCloseTo(0.2, 3);
    expect(observer.see(looking([0, 0, 0], at(3.4)), 2.1, 10).turning).toBeCloseTo(0.2, 3);
    expect(observer.see(looking([0, 0, 0], at(3.4)), 3, 10).turning).toBe(0);
  });
});
