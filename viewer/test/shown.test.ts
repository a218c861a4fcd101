import { describe, expect, it } from "vitest";
import { makePlan } from "../src/core/plan.js";
import { shownBy, type Shown } from "../src/core/shown.js";
import { DIRECTIONS, hold, makeWorld, tilesOf, view } from "./worlds.js";

/** Straight down on the world of 4 m x 4 m, which fills the picture. */
const DOWN = { toX: [50, 0, -200], toY: [0, 50, -200], toW: [0, 0, -1], width: 400, height: 400 } as const;

function shown(root: Parameters<typeof makePlan>[0][number], changes = {}): Shown {
  const seen = view({ eye: [2, 2, 4], ...changes });
  return shownBy(makePlan([root], DIRECTIONS, seen), seen, DOWN);
}

describe("shownBy", () => {
  it("counts every cell as empty while nothing is held", () => {
    expect(shown(makeWorld().root)).toEqual({ empty: 16, standInShare: 0, standInLevels: 0 });
  });

  it("finds nothing wrong with a picture that is complete", () => {
    const { root, cells } = makeWorld();
    for (const cell of cells.values()) hold(tilesOf(cell));
    expect(shown(root)).toEqual({ empty: 0, standInShare: 0, standInLevels: 0 });
  });

  it("tells what part of the picture something coarser stands in for, and how much coarser it is", () => {
    const { root, cells } = makeWorld();
    for (const cell of cells.values()) if (cell.name !== "0/1/1/0") hold(tilesOf(cell));
    // The grid has 8 x 6 rays for each leaf of the 4 x 4.
    expect(shown(root)).toEqual({ empty: 0, standInShare: 1 / 16, standInLevels: 1 });
  });

  it("knows that finer cells cover one that is not there", () => {
    const { root, cells } = makeWorld();
    for (const cell of cells.values()) if (cell.level === 0) hold(tilesOf(cell));
    expect(shown(root, { radius: 1 })).toEqual({ empty: 0, standInShare: 0, standInLevels: 0 });
    cells.get("0/0/0/0")!.views.forEach(({ layers }) => layers.forEach((layer) => (layer.state = "absent")));
    expect(shown(root, { radius: 1 }).empty).toBe(1);
  });

  it("takes a picture of a near leaf for a level coarser than its geometry", () => {
    const { root, cells } = makeWorld();
    for (const cell of cells.values()) hold(tilesOf(cell));
    expect(shown(root, { near: 100 })).toEqual({ empty: 0, standInShare: 1, standInLevels: 1 });
    for (const cell of cells.values()) if (cell.geometry) hold([cell.geometry.leaf]);
    expect(shown(root, { near: 100 })).toEqual({ empty: 0, standInShare: 0, standInLevels: 0 });
  });
});
