import { describe, expect, it } from "vitest";
import { joinWants, LookAhead } from "../src/core/ahead.js";
import { Motion, positionsAhead } from "../src/core/motion.js";
import type { Vector3 } from "../src/core/vector.js";
import { coarseFirst, listWants, URGENCY, type Want } from "../src/core/wants.js";
import { makePlan } from "../src/core/plan.js";
import { DIRECTIONS, makeWorld, MANIFEST, tilesOf, view } from "./worlds.js";

/** Flies east at 2 m/s, ten frames a second, from x = `from` on; returns where it ends. */
function fly(motion: { follow(eye: Vector3, at: number, jump: number): void }, frames: number, from = 0): number {
  for (let n = 0; n <= frames; n++) motion.follow([from + 0.2 * n, 0, 1], 0.1 * n, 1);
  return 0.1 * frames;
}

describe("Motion", () => {
  it("tells how fast the eye moves", () => {
    const motion = new Motion();
    const now = fly(motion, 20);
    expect(motion.at(now)[0]).toBeCloseTo(2, 6);
    expect(motion.at(now)[1]).toBe(0);
  });

  it("comes to a new speed over a few frames, not at once", () => {
    const motion = new Motion();
    const now = fly(motion, 20);
    motion.follow([4, 0.2, 1], now + 0.1, 1);
    const [x, y] = motion.at(now + 0.1);
    expect(x).toBeGreaterThan(1);
    expect(x).toBeLessThan(2);
    expect(y).toBeGreaterThan(0);
    expect(y).toBeLessThan(1);
  });

  it("takes a jump for no flight, and rests when nothing moves", () => {
    const motion = new Motion();
    const now = fly(motion, 20);
    expect(motion.at(now + 0.4)).not.toEqual([0, 0, 0]);
    expect(motion.at(now + 0.6)).toEqual([0, 0, 0]);
    motion.follow([50, 0, 1], now + 0.1, 1);
    expect(motion.at(now + 0.1)).toEqual([0, 0, 0]);
  });
});

describe("positionsAhead", () => {
  it("places them along the flight, nearest first", () => {
    expect(positionsAhead([1, 2, 3], [10, 0, 0], 8, 1)).toEqual([[11, 2, 3], [21, 2, 3], [41, 2, 3], [81, 2, 3]]);
  });

  it("leaves out what is too near the last", () => {
    expect(positionsAhead([0, 0, 0], [10, 0, 0], 8, 15)).toEqual([[20, 0, 0], [40, 0, 0], [80, 0, 0]]);
    expect(positionsAhead([0, 0, 0], [0.1, 0, 0], 8, 15)).toEqual([]);
  });
});

describe("LookAhead", () => {
  const { root, cells } = makeWorld();
  const world = { roots: [root], manifest: MANIFEST, lacks: () => false };
  // Leaves are fine enough from half a metre on and seen within half a metre to the east.
  const seen = (x: number) => view({ eye: [x, 0.5, 0.5], radius: 0.5, near: 0, frustum: [{ normal: [-1, 0, 0], offset: x + 0.5 }, { normal: [1, 0, 0], offset: 0.5 - x }] });
  const wanted = (wants: readonly Want[]): Set<string> => new Set(wants.map(({ resource }) => resource.cell!.name));

  it("wants what the picture shows from where the eye will be, ordered by distance from where it is", () => {
    const ahead = new LookAhead();
    for (let n = 0; n <= 5; n++) ahead.follow([0.1 * n, 0.5, 0.5], 0.1 * n, 1, 2);
    let wants: readonly Want[] = [];
    for (let n = 0; n < 4; n++) wants = ahead.look(world, seen(0.5));
    // At 1 m/s for 2 s: to x = 2.5, where leaves in column 2 are near.
    expect(wanted(wants)).toContain("0/2/0/0");
    expect(new Set(wants.map(({ urgency }) => urgency))).toEqual(new Set([URGENCY.ahead]));
    const distances = wants.map(({ distance }) => distance);
    expect(distances).toEqual([...distances].sort((a, b) => a - b));
    expect(new Set(wants.map(({ resource }) => resource)).size).toBe(wants.length);
  });

  it("looks from one position a call", () => {
    const ahead = new LookAhead();
    for (let n = 0; n <= 5; n++) ahead.follow([0.1 * n, 0.5, 0.5], 0.1 * n, 1, 2);
    const counts = [0, 1, 2, 3, 4].map(() => wanted(ahead.look(world, seen(0.5))).size);
    expect(counts[0]).toBeLessThan(counts[3]!);
    expect(counts[4]).toBe(counts[3]);
  });

  it("looks again after a tenth of the smallest cell, not before", () => {
    const ahead = new LookAhead();
    for (let n = 0; n <= 5; n++) ahead.follow([0.1 * n, 0.5, 0.5], 0.1 * n, 1, 2);
    for (let n = 0; n < 4; n++) ahead.look(world, seen(0.5));
    const before = ahead.look(world, seen(0.5));
    ahead.follow([0.55, 0.5, 0.5], 0.6, 1, 2);
    expect(ahead.look(world, seen(0.55))).toBe(before);
    ahead.follow([0.7, 0.5, 0.5], 0.7, 1, 2);
    expect(ahead.look(world, seen(0.7))).not.toBe(before);
  });

  it("wants nothing ahead at rest, or when it is switched off", () => {
    const ahead = new LookAhead();
    for (let n = 0; n <= 5; n++) ahead.follow([0.1 * n, 0.5, 0.5], 0.1 * n, 1, 0);
    expect(ahead.look(world, seen(0.5))).toEqual([]);
    for (let n = 0; n <= 5; n++) ahead.follow([0.1 * n, 0.5, 0.5], 1 + 0.1 * n, 1, 2);
    expect(ahead.look(world, seen(0.5))).not.toEqual([]);
    ahead.follow([0.5, 0.5, 0.5], 9, 1, 2);
    expect(ahead.look(world, seen(0.5))).toEqual([]);
  });

  it("counts a value once, as urgent as it is anywhere", () => {
    const [tile, other] = tilesOf(cells.get("0/0/0/0")!);
    const want = (resource: typeof tile, urgency: number, distance: number): Want => ({ resource: resource!, urgency, distance, level: 0 });
    const joined = joinWants([[want(tile, URGENCY.ahead, 1), want(other, URGENCY.ahead, 2)], [want(tile, URGENCY.unseen, 0), want(other, URGENCY.seen, 9)]]);
    expect(joined.map(({ resource, urgency }) => [resource, urgency])).toEqual([[other, URGENCY.seen], [tile, URGENCY.ahead]]);
  });

  it("brings what can stand in ahead of the picture when time is short", () => {
    const everything = view({ eye: [0.1, 0.1, 0.5] });
    const wants = listWants([root], makePlan([root], DIRECTIONS, everything), MANIFEST, everything);
    const first = coarseFirst(wants, everything.frustum).filter(({ urgency }) => urgency === URGENCY.root);
    expect(wants.some(({ urgency }) => urgency === URGENCY.cover)).toBe(false);
    // Two levels above the leaves there is the root alone, which comes first as it is.
    expect(wanted(first)).toEqual(new Set([root.name]));
    const near = view({ eye: [0.1, 0.1, 0.5], near: 0.2 });
    const mixed = coarseFirst(listWants([root], makePlan([root], DIRECTIONS, near), MANIFEST, near), near.frustum);
    expect(wanted(mixed.filter(({ urgency }) => urgency === URGENCY.root))).toEqual(new Set([root.name, "0/0/0/0"]));
  });
});
