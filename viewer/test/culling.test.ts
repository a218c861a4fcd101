import { describe, expect, it } from "vitest";
import { Culler, type CullableTile, type Culling } from "../src/core/culling.js";
import { DepthPyramid } from "../src/core/depthpyramid.js";
import { LatticeView, sameProjection, type Projection } from "../src/core/projection.js";
import { Ranges } from "../src/core/ranges.js";
import type { Box, Vector3 } from "../src/core/vector.js";

/** Looks north from 200 m south of the origin; a picture of 64 x 48 pixels, 90° across. */
function lookingNorth(eye: Vector3 = [0, -200, 0]): Projection {
  return { eye, toX: [32, 32, 0], toY: [0, 24, 32], toW: [0, 1, 0], near: 1, width: 64, height: 48 };
}

/** A tile seen from the south: u east, v down, w north; pitch 1 m. */
const AXES = { u: [1, 0, 0], v: [0, 0, -1], w: [0, 1, 0] } as const;

interface Block {
  readonly lower: Vector3;
  readonly upper: Vector3;
  readonly cone?: readonly number[];
}

function tileOf(blocks: readonly Block[]): CullableTile {
  const boxes = Float32Array.from(blocks.flatMap(({ lower, upper }) => [...lower, ...upper]));
  const extremes = [0, 1, 2].map((a) => Math.min(...blocks.map(({ lower }) => lower[a]!)));
  const others = [0, 1, 2].map((a) => Math.max(...blocks.map(({ upper }) => upper[a]!)));
  return {
    lattice: { axes: AXES, corner: [0, 0, 0], pitch: 1 },
    extent: Float32Array.from([...extremes, ...others]),
    blocks: {
      count: blocks.length,
      starts: Uint32Array.from({ length: blocks.length + 1 }, (_, n) => 10 * n),
      boxes,
      cones: Float32Array.from(blocks.flatMap(({ cone = [0, 0, -1, 0, 1] }) => [...cone])),
    },
  };
}

const block = (u: number, v: number, w: number, size = 4): Block => ({ lower: [u, v, w], upper: [u + size, v + size, w + size] });
const drawnOf = (culler: Culler): number[][] =>
  Array.from({ length: culler.ranges.total }, (_, n) => [culler.ranges.firsts[n]!, culler.ranges.counts[n]!]);

/** A picture in which one sees `distance` metres far everywhere, but `holes` deep in some squares of 8 pixels. */
function wall(view: Projection, distance: number, holes: Readonly<Record<number, number>> = {}): DepthPyramid {
  const values = new Float32Array(8 * 6).fill(view.near / distance);
  for (const [at, depth] of Object.entries(holes)) values[Number(at)] = depth;
  return new DepthPyramid(view, 8, 8, values);
}

describe("blocks", () => {
  const middle = block(-2, -2, 0);

  it("outside the picture are left out, adjacent runs are drawn as one", () => {
    const tile = tileOf([block(-300, 0, 0), middle, block(4, 0, 0), block(0, 400, 0), block(-2, -2, -300), block(2, 2, 50)]);
    const culler = new Culler(lookingNorth(), "frustum", null);
    expect(culler.add(tile)).toBe(true);
    expect(drawnOf(culler)).toEqual([[10, 20], [50, 10]]);
    expect([culler.inFrustum, culler.drawn, culler.isGuess]).toEqual([30, 30, false]);
    const all = new Culler(lookingNorth(), "none", wall(lookingNorth(), 10));
    all.add(tile);
    expect(drawnOf(all)).toEqual([[0, 60]]);
    expect(new Culler(lookingNorth(), "none", null).add(tileOf([block(-300, 0, 0)]))).toBe(false);
  });

  it("that show nothing but backs are left out, with a margin for their size", () => {
    const facing = (n: Vector3, half = 0): Block => ({ ...middle, cone: [...n, Math.cos(half), Math.sin(half)] });
    const isDrawn = (one: Block): boolean => new Culler(lookingNorth(), "all", null).add(tileOf([one]));
    expect(isDrawn(facing([0, 0, -1]))).toBe(true);
    expect(isDrawn(facing([0, 0, 1]))).toBe(false);
    expect(isDrawn(facing([0, 0, 1], 1.5))).toBe(false);
    expect(isDrawn(facing([0, 0, 1], 1.57))).toBe(true);
    expect(isDrawn(facing([1, 0, 0]))).toBe(true);
    expect(isDrawn({ ...block(-2, -2, 0), cone: [0, 0, 1, 0, 1] })).toBe(true);
  });

  it("behind what was seen before are left out, and a picture tells whether that was right", () => {
    const view = lookingNorth();
    const before = wall(view, 100);
    const culler = new Culler(view, "all", before);
    culler.add(tileOf([middle, block(-2, -2, -120)]));
    expect(drawnOf(culler)).toEqual([[10, 10]]);
    expect(culler.isGuess).toBe(true);
    expect(culler.isRight(wall(view, 150))).toBe(true);
    expect(culler.isRight(wall(view, 201))).toBe(false);
    expect(culler.isRight(wall(view, 100, { [2 * 8 + 4]: 0 }))).toBe(false);
    expect(culler.isRight(wall(view, 100, { 0: 0 }))).toBe(true);
  });

  it("are hidden from elsewhere only with a square to spare, and never beside the picture from before", () => {
    const drawn = (eye: Vector3, hole: number, one = middle): boolean => {
      const before = wall(lookingNorth(), 100, { [hole]: 0 });
      return new Culler(lookingNorth(eye), "all", before).add(tileOf([one]));
    };
    // The middle of the picture is the corner of four squares; one column farther left nothing of the block is seen.
    expect(drawn([0, -200, 0], 2 * 8 + 2)).toBe(false);
    expect(drawn([1, -200, 0], 2 * 8 + 2)).toBe(true);
    expect(drawn([1, -200, 0], 2 * 8 + 0)).toBe(false);
    const corner = block(-198, -2, 0);
    expect(drawn([0, -200, 0], 47, corner)).toBe(false);
    expect(drawn([1, -200, 0], 47, corner)).toBe(true);
  });

  it("close to the eye are drawn whatever was seen", () => {
    const near = new Culler(lookingNorth(), "all", wall(lookingNorth(), 2));
    near.add(tileOf([block(-2, -2, -190), middle]));
    expect(drawnOf(near)).toEqual([[0, 10]]);
  });

  it("of a tile that is hidden as a whole count as in the frustum", () => {
    const culler = new Culler(lookingNorth(), "all", wall(lookingNorth(), 100));
    expect(culler.add(tileOf([middle, block(10, 10, 20)]))).toBe(false);
    expect([culler.inFrustum, culler.drawn]).toEqual([20, 0]);
    expect(culler.isRight(wall(lookingNorth(), 300))).toBe(false);
  });
});

describe("boxes", () => {
  const box: Box = { lower: [-2, -2, -2], upper: [2, 2, 2] };

  it("are left out when they are beside the picture, or hidden before; those at hand too", () => {
    const drawn = (culling: Culling, one: Box, farthest: number): boolean => new Culler(lookingNorth(), culling, wall(lookingNorth(), farthest)).addBox(one);
    expect(drawn("all", box, 150)).toBe(false);
    expect(drawn("frustum", box, 150)).toBe(true);
    expect(drawn("all", box, 199)).toBe(true);
    expect(drawn("all", { lower: [-2, -152, -2], upper: [2, -148, 2] }, 10)).toBe(false);
    expect(drawn("frustum", { lower: [-300, 0, 0], upper: [-290, 4, 4] }, 150)).toBe(false);
  });

  it("are a guess until the picture without them hides them as well", () => {
    const culler = new Culler(lookingNorth(), "all", wall(lookingNorth(), 100));
    culler.addBox(box);
    expect(culler.isGuess).toBe(true);
    expect(culler.isRight(wall(lookingNorth(), 150))).toBe(true);
    expect(culler.isRight(wall(lookingNorth(), 201))).toBe(false);
  });
});

it("a pyramid sees no farther than its farthest square, at any size", () => {
  const view = lookingNorth();
  const random = (n: number): number => Math.abs(Math.sin(n * 12.9898) * 43758.5453) % 1;
  const [columns, rows, texel] = [37, 23, 3];
  const values = Float32Array.from({ length: columns * rows }, (_, n) => 1 / (1 + 99 * random(n)));
  const pyramid = new DepthPyramid(view, texel, columns, values);
  for (let n = 0; n < 300; n++) {
    const [left, bottom] = [random(n + 0.1) * 100 - 5, random(n + 0.2) * 60 - 5];
    const [right, top] = [left + random(n + 0.3) * 90, bottom + random(n + 0.4) * 60];
    let farthest = 0;
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        const beside = column < Math.floor(left / texel) || column > Math.floor(right / texel);
        if (beside || row < Math.floor(bottom / texel) || row > Math.floor(top / texel)) continue;
        farthest = Math.max(farthest, 1 / values[row * columns + column]!);
      }
    }
    expect(pyramid.closes(left, bottom, right, top, farthest * 0.999)).toBe(farthest === 0);
    expect(pyramid.closes(left, bottom, right, top, 101)).toBe(true);
  }
});

it("a lattice in a picture projects as the picture does", () => {
  const view = lookingNorth([3, -50, 7]);
  const placed = new LatticeView(view, { axes: AXES, corner: [10, -20, 30], pitch: 0.5 });
  // (u, v, w) = (4, 6, 8) pitches lies at east 12, up 17, north 34.
  const c = [4 - placed.eye[0], 6 - placed.eye[1], 8 - placed.eye[2]];
  const part = (row: Vector3): number => row[0] * c[0]! + row[1] * c[1]! + row[2] * c[2]!;
  expect(part(placed.toW)).toBeCloseTo(84, 9);
  expect(part(placed.toX)).toBeCloseTo(32 * 9 + 32 * 84, 9);
  expect(part(placed.toY)).toBeCloseTo(24 * 84 + 32 * 10, 9);
  expect(sameProjection(view, { ...view, eye: [3, -50, 7] })).toBe(true);
  expect(sameProjection(view, { ...view, width: 65 })).toBe(false);
});

it("runs of one tile are joined where they touch, those of two never", () => {
  const ranges = new Ranges();
  for (let n = 0; n < 3000; n++) {
    ranges.begin();
    ranges.add(0, 5);
    ranges.add(5, 7);
    ranges.add(8, 9);
  }
  expect([ranges.total, ranges.pixels, ranges.from, ranges.length]).toEqual([6000, 24_000, 5998, 2]);
  expect([...ranges.firsts.subarray(5998, 6000)]).toEqual([0, 8]);
});
