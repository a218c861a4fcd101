import { ClampToEdgeWrapping, SRGBColorSpace, type BufferAttribute } from "three";
import { describe, expect, it } from "vitest";
import { SharedMeshes, type Cell } from "../src/core/cell.js";
import type { Level } from "../src/core/decode/levels.js";
import type { DecodePool } from "../src/core/decode/pool.js";
import { bestShown, boardTransform, heldBoards, placedAlone, sightOf, squareness, type ImpostorForm } from "../src/core/impostors.js";
import type { Impostor, InstancedMesh } from "../src/core/indextile.js";
import { placedMesh, type Instance, type PlacedMesh } from "../src/core/instances.js";
import { makePlan, samePlan, type Plan } from "../src/core/plan.js";
import { Resource } from "../src/core/resource.js";
import type { Servers } from "../src/core/servers.js";
import type { Vector3 } from "../src/core/vector.js";
import { listWants, URGENCY } from "../src/core/wants.js";
import { boardModel } from "../src/three/near/board.js";
import { cutoutOf, TextureShelf } from "../src/three/near/textures.js";
import { DIRECTIONS, hold, makeWorld, MANIFEST, tilesOf, view } from "./worlds.js";

const hash = (n: number): string => n.toString(16).padStart(16, "0");
/** 4 x 6 x 5 m, the middle at (1, 1, 2.5). */
const BOX = [[-1, -2, 0], [3, 4, 5]] as const;
const MIDDLE: Vector3 = [1, 1, 2.5];
const STILL = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];

function impostor(rows: number, sides: number, errors?: readonly number[]): Impostor {
  const images = Array.from({ length: sides }, (_, side) => [hash(1000 * rows + side), 10 * rows] as const);
  return { rows, images, ...(errors && { errors }) };
}

/** A mesh like that, placed once, in a leaf at (100, 200, 0). */
function place(rows: readonly number[], impostors: readonly Impostor[] = [impostor(96, 8)]): PlacedMesh {
  const levels = [{ hash: hash(1), bytes: 900, triangles: 200 }];
  const listed: InstancedMesh = { bounds: BOX, levels, objects: [7], transforms: [rows], impostors };
  return placedMesh(listed, [100, 200, 0], new SharedMeshes().formsOf(listed));
}

const own = ({ instances }: PlacedMesh): Instance => instances[0]!;

/** An eye that lies 7 m before the middle of an instance in a direction of its mesh's frame, local metres. */
function eyeAt(placed: PlacedMesh, [x, y, z]: Vector3): Vector3 {
  const length = Math.hypot(x, y, z) / 7;
  const point = [MIDDLE[0] + x / length, MIDDLE[1] + y / length, MIDDLE[2] + z / length, 1];
  const { transform } = own(placed);
  const moved = (row: number): number => point.reduce((sum, part, column) => sum + part * transform[row + 4 * column]!, 0);
  const along = (row: 0 | 1 | 2): number => placed.corner[row] + moved(row);
  return [along(0), along(1), along(2)];
}

const squares = (placed: PlacedMesh, direction: Vector3, of: ImpostorForm = placed.impostors[0]!): number[] =>
  of.boards.map((board) => squareness(board, sightOf(placed, own(placed), eyeAt(placed, direction))));

/** Number of the side that an eye in a direction sees of those that are held, head on or not. */
function best(placed: PlacedMesh, direction: Vector3, least = 0): number {
  const sight = sightOf(placed, own(placed), eyeAt(placed, direction));
  const board = bestShown(heldBoards(placed.impostors), sight, 1, 1, least)[0];
  return placed.impostors.flatMap(({ boards }) => boards).findIndex((one) => one === board);
}

const around = (degrees: number, up = 0): Vector3 => [Math.cos((degrees / 180) * Math.PI), Math.sin((degrees / 180) * Math.PI), up];

describe("boards", () => {
  it("stand across their directions, as deep as they are wide", () => {
    // Along x one sees y to the right, 6 m of it; along y one sees x to the left, 4 m of it.
    const near = (...parts: number[]): unknown[] => parts.map((part) => expect.closeTo(part, 12));
    expect([...boardTransform(BOX, 0, 0)]).toEqual(near(0, 6, 0, 0, 6, 0, 0, 0, 0, 0, 5, 0, 1, 1, 2.5, 1));
    expect([...boardTransform(BOX, Math.PI / 2, 0)]).toEqual(near(-4, 0, 0, 0, 0, 4, 0, 0, 0, 0, 5, 0, 1, 1, 2.5, 1));
    expect([...boardTransform(BOX, Math.PI / 4, 0)]).toEqual(near(-5, 5, 0, 0, 5, 5, 0, 0, 0, 0, 5, 0, 1, 1, 2.5, 1));
    // From 45 degrees above along x: of x and z together 9 / sqrt 2 m, upwards and away from the eye.
    const half = Math.sqrt(0.5);
    const leaning = near(0, 6, 0, 0, 6 * half, 0, 6 * half, 0, -4.5, 0, 4.5, 0, 1, 1, 2.5, 1);
    expect([...boardTransform(BOX, 0, Math.PI / 4)]).toEqual(leaning);
  });

  it("are made as they are sent, of a size that the mesh has, for eyes above and below", () => {
    const shared = new SharedMeshes();
    const levels = [{ hash: hash(1), bytes: 900, triangles: 200 }];
    const listed: InstancedMesh = { bounds: BOX, levels, objects: [7], transforms: [STILL], impostors: [impostor(96, 8)] };
    const placed = placedMesh(listed, [100, 200, 0], shared.formsOf(listed));
    const { boards } = placed.impostors[0]!;
    const find = (rest: string): Resource | null => shared.find(`impostor/${hash(1)}-${rest}`);
    for (const rest of ["95-0-6", "96-16-6", "96-0-9", "96-00-6", "096-0-6", "96-0", "96-0-6-1"]) expect(find(rest)).toBeNull();
    expect(shared.find(`impostor/${hash(2)}-96-0-6`)).toBeNull();
    expect(boards).toHaveLength(8);
    const above = find("96-4-6")!;
    expect(above).toMatchObject({ kind: "impostor", isPushed: true, state: "absent" });
    expect([find("96-4-6"), boards.length]).toEqual([above, 9]);
    hold(boards.map(({ mesh }) => mesh));
    // From north and 45 degrees above that one, from the side that of the north.
    expect([best(placed, [0, 1, 1]), best(placed, [0, 1, 0.1]), best(placed, [0, 0.2, 1]), best(placed, [0, 0, -1])]).toEqual([8, 2, 8, -1]);
    expect(boards[8]!.transform).toEqual(boardTransform(BOX, Math.PI / 2, Math.PI / 4));
    expect(find("96-0-0")).not.toBeNull();
    hold([find("96-0-0")!]);
    expect(best(placed, [0, 0, -1])).toBe(9);
  });

  it("stand so where their instance does, turned, stretched and mirrored as it is", () => {
    // x to y twice as large, y to -x, z mirrored.
    const placed = place([0, -1, 0, 10, 2, 0, 0, 20, 0, 0, -1, 30]);
    const [front, , left] = place(STILL, [impostor(96, 8)]).impostors[0]!.boards;
    const drawn = placedAlone(placed, own(placed), front!);
    expect([...drawn.instances[0]!.transform]).toEqual([-6, 0, 0, 0, 0, 12, 0, 0, 0, 0, -5, 0, 9, 22, 27.5, 1]);
    expect(drawn).toMatchObject({ corner: placed.corner, bounds: own(placed).bounds });
    expect(drawn.instances[0]).toMatchObject({ object: 7, bounds: own(placed).bounds });
    expect([...placedAlone(placed, own(placed), left!).instances[0]!.transform]).toEqual(
      [0, -8, 0, 0, -4, 0, 0, 0, 0, 0, -5, 0, 9, 22, 27.5, 1].map((part) => expect.closeTo(part, 6)),
    );
    expect(placedAlone(placed, own(placed), front!)).toBe(drawn);
    expect(placedAlone(placed, own(placed), null).instances).toEqual([own(placed)]);
    expect(placedAlone(placed, own(placed), null)).toBe(placedAlone(placed, own(placed), null));
  });

  it("show the less, the more from the side they are seen", () => {
    const placed = place(STILL, [impostor(96, 4)]);
    expect(squares(placed, [1, 0, 0])).toEqual([1, 0, 0, 0].map((part) => expect.closeTo(part, 12)));
    const half = (0.5 / 0.75) ** 1.5;
    expect(squares(placed, [1, 1, 0])).toEqual([half, half, 0, 0].map((part) => expect.closeTo(part, 6)));
    const sixth = (0.5 / Math.sqrt(0.75)) ** 3;
    expect(squares(placed, [-Math.sqrt(0.75), -0.5, 0])).toEqual([0, 0, 1, sixth].map((part) => expect.closeTo(part, 6)));
    // Half way up to the zenith, and from there.
    expect(squares(placed, [1, 0, 1])).toEqual([half, 0, 0, 0].map((part) => expect.closeTo(part, 6)));
    expect(squares(placed, [0, 0, 1])).toEqual([0, 0, 0, 0]);
    expect(squares(placed, [0, 0, -1])).toEqual([0, 0, 0, 0]);
  });

  it.each([
    ["turned", [0, -1, 0, 10, 1, 0, 0, 20, 0, 0, 1, 30]],
    ["stretched", [0.01, 0, 0, 1, 0, 300, 0, 2, 0, 0, 5, 3]],
    ["mirrored", [1, 0, 0, 1, 0, -1, 0, 2, 0, 0, 1, 3]],
    ["sheared", [1, 0.5, 0, 1, 0, 1, 0.25, 2, 0, 0, 1, 3]],
  ])("are seen in the mesh's own frame (%s)", (_, rows) => {
    for (const direction of [[1, 0.2, 0.3], [-3, 1, 1], [0, -1, 0.1]] as const) {
      expect(squares(place(rows), direction)).toEqual(squares(place(STILL), direction).map((part) => expect.closeTo(part, 5)));
    }
  });

  it("are not seen of what is flat, or from its middle", () => {
    expect(squares(place([1, 0, 0, 1, 2, 0, 0, 2, 0, 0, 1, 3]), [1, 0, 0])).toEqual(new Array(8).fill(0));
    expect(squares(place(new Array<number>(12).fill(0)), [1, 0, 0])).toEqual(new Array(8).fill(0));
    const placed = place(STILL);
    expect(sightOf(placed, own(placed), [101, 201, 2.5])).toEqual([0, 0, 0]);
  });

  it("are those of the side that is seen most squarely of all that are there", () => {
    const placed = place(STILL);
    const [{ boards }] = placed.impostors as [ImpostorForm];
    expect(best(placed, around(0))).toBe(-1);
    hold(boards.map(({ mesh }) => mesh));
    for (let side = 0; side < 8; side++) {
      expect(best(placed, around(45 * side))).toBe(side);
      // Steeply from above no two show the same.
      for (const aside of [-20, 20]) expect(best(placed, around(45 * side + aside, 1))).toBe(side);
    }
    // Of two that show as much, all of it, that which is seen more squarely.
    expect([best(placed, around(20)), best(placed, around(25)), best(placed, around(31)), best(placed, around(-25))]).toEqual([0, 1, 1, 7]);
    expect(best(placed, [0, 0, 1])).toBe(-1);
    boards[2]!.mesh.state = "absent";
    expect(best(placed, around(80))).toBe(1);
    expect(best(placed, around(80), 0.5)).toBe(1);
    expect(best(placed, around(80), 0.9)).toBe(-1);
  });

  it("are of the impostor that shows most, of equals of the finer", () => {
    const placed = place(STILL, [impostor(96, 8, [30, 60, 90]), impostor(24, 6, [30, 90, 120])]);
    const [fine, coarse] = placed.impostors as [ImpostorForm, ImpostorForm];
    expect([fine.told, coarse.told]).toEqual([[30, 60, 90], [30, 90, 120]].map((told) => told.map((error) => error / 255)));
    expect(place(STILL).impostors[0]!.told).toEqual([0, 0, 0]);
    hold([...fine.boards, ...coarse.boards].map(({ mesh }) => mesh));
    const at = (degrees: number, width: number): string => {
      const sight = sightOf(placed, own(placed), eyeAt(placed, around(degrees)));
      const board = bestShown(heldBoards(placed.impostors), sight, 1, width, 0)[0]!;
      return board.mesh.key;
    };
    // Where a pixel is four times as wide as one of a leaf's pictures both are told to look the same.
    expect(at(60, 4)).toBe(fine.boards[1]!.mesh.key);
    fine.boards[1]!.mesh.state = "absent";
    expect(at(55, 4)).toBe(coarse.boards[1]!.mesh.key);
    fine.boards[1]!.mesh.state = "held";
    expect([at(50, 1), at(0, 0.1)]).toEqual([fine.boards[1]!.mesh.key, fine.boards[0]!.mesh.key]);
  });

  it("are shared by all leaves that the mesh is placed in, but not with a larger one that looks the same", () => {
    const shared = new SharedMeshes();
    const listed: InstancedMesh = {
      bounds: BOX, levels: [{ hash: hash(1), bytes: 900, triangles: 200 }],
      objects: [7], transforms: [STILL], impostors: [impostor(96, 8)],
    };
    const found = shared.formsOf(listed);
    expect(shared.formsOf(structuredClone(listed))).toBe(found);
    const [level] = listed.levels;
    const larger = shared.formsOf({ ...listed, bounds: [[-2, -4, 0], [6, 8, 10]], levels: [{ ...level!, hash: hash(2) }] });
    const [one, other] = [found, larger].map(({ impostors }) => impostors[0]!.boards[0]!);
    expect(other!.mesh).toBe(one!.mesh);
    expect([...other!.transform.subarray(0, 8)]).toEqual([...one!.transform.subarray(0, 8)].map((part) => 2 * part));
    const [name, bytes] = found.impostors[0]!.entry.images[0]!;
    expect(one!.mesh).toMatchObject({ key: `texture/${name}`, kind: "impostor", bytes, cell: null });
    expect(shared.find(one!.mesh.key)).toBe(one!.mesh);
    // Leaves of a world from before tell of none.
    const { impostors: _, ...before } = listed;
    expect(shared.formsOf(before).impostors).toEqual([]);
    expect(shared.formsOf(before).forms[0]!.mesh).toBe(found.forms[0]!.mesh);
  });
});

/** A tree twice in the middle of a leaf, full, coarse, and by four images. */
const TREE: InstancedMesh = {
  bounds: [[-0.1, -0.1, 0], [0.1, 0.1, 0.5]],
  levels: [{ hash: hash(1), bytes: 900, triangles: 100 }, { hash: hash(2), bytes: 90, triangles: 20, errors: [51, 102, 153] }],
  objects: [5, 6],
  transforms: [[1, 0, 0, 0.25, 0, 1, 0, 0.5, 0, 0, 1, 0], [0, -1, 0, 0.75, 1, 0, 0, 0.5, 0, 0, 1, 0]],
  impostors: [impostor(96, 4, [26, 51, 77])],
};
/** From the south and far away, where all cells of the cut are leaves and none is near. */
const AFAR = { near: 0.01, eye: [0.25, -50, 0.5] as Vector3, farGeometry: true };
const plan = (root: Cell, changes = {}): Plan => makePlan([root], DIRECTIONS, view({ ...AFAR, ...changes }));

function trees(tree: InstancedMesh = TREE) {
  const world = makeWorld({ instances: [tree] });
  const [{ forms, impostors }] = world.cells.get("0/0/0/0")!.instances as [PlacedMesh];
  const boards = impostors[0]!.boards.map(({ mesh }) => mesh);
  /** Of the leaf at the lower corner: objects, and what each is drawn by. */
  const drawn = (found: Plan): string[] =>
    found.instances.filter(({ placed }) => placed.corner.every((at) => at === 0)).map(({ placed, form }) => {
      const by = "level" in form ? `level ${form.level}` : `side ${boards.indexOf(form.mesh)}`;
      return `${placed.instances.map(({ object }) => object).join()} ${by}`;
    });
  return { ...world, full: forms[0]!.mesh, coarse: forms.at(-1)!.mesh, boards, drawn };
}

describe("makePlan", () => {
  it("draws each instance by the board of its own that looks south, if there is one", () => {
    const { root, boards, drawn } = trees();
    expect(drawn(plan(root))).toEqual([]);
    // South is side 3; of the one that is turned by a quarter it is side 2.
    hold([boards[3]!]);
    expect(drawn(plan(root))).toEqual(["5 side 3"]);
    hold(boards.slice(0, 3));
    expect(drawn(plan(root))).toEqual(["5 side 3", "6 side 2"]);
    expect(drawn(plan(root, { eye: [50, 0.5, 0.5] }))).toEqual(["5 side 0", "6 side 3"]);
    expect(plan(root).instances).toHaveLength(32);
  });

  it("draws what shows more, a board or a level, and never a board in place of the mesh itself", () => {
    const { root, coarse, full, boards, drawn } = trees();
    hold([coarse]);
    expect(drawn(plan(root))).toEqual(["5,6 level 1"]);
    hold([boards[3]!]);
    expect(drawn(plan(root))).toEqual(["5 side 3", "6 level 1"]);
    // From 60 degrees above it shows (1/2 / sin 60°)³ of .9, less than .8.
    expect(drawn(plan(root, { eye: [0.25, -25, 43.3 + 0.25] }))).toEqual(["5,6 level 1"]);
    hold([full]);
    expect(drawn(plan(root))).toEqual(["5,6 level 0"]);
  });

  it("takes a level that shows as much", () => {
    const errors = [51, 102, 153];
    const { root, coarse, boards, drawn } = trees({ ...TREE, impostors: [impostor(96, 4, errors)] });
    hold(boards);
    expect(drawn(plan(root))).toEqual(["5 side 3", "6 side 2"]);
    hold([coarse]);
    expect(drawn(plan(root))).toEqual(["5,6 level 1"]);
  });

  it("draws nothing by boards from straight above", () => {
    const { root, boards, drawn } = trees({ ...TREE, objects: [5], transforms: [[1, 0, 0, 0.25, 0, 1, 0, 0.5, 0, 0, 1, 0]] });
    hold(boards);
    expect(drawn(plan(root, { eye: [0.25, 0.5, 60] }))).toEqual([]);
  });

  it("draws boards where all levels have too many triangles for so far away, and near", () => {
    const { root, full, boards, drawn } = trees({ ...TREE, levels: [{ ...TREE.levels[0]!, triangles: 1e6 }] });
    hold([full]);
    expect(drawn(plan(root))).toEqual([]);
    hold(boards);
    expect(drawn(plan(root))).toEqual(["5 side 3", "6 side 2"]);
    full.state = "absent";
    expect(drawn(plan(root, { near: 1, eye: [0.25, -0.2, 0.2], farGeometry: false }))[0]).toBe("5 side 3");
  });

  it("draws the same by the same, and something else by another board", () => {
    const { root, coarse, boards } = trees();
    hold([coarse, boards[3]!]);
    const first = plan(root);
    expect(samePlan(first, plan(root, { eye: [0.2, -49, 0.6] }))).toBe(true);
    plan(root).instances.forEach(({ placed }, n) => expect(placed).toBe(first.instances[n]!.placed));
    hold([boards[2]!]);
    expect(samePlan(first, plan(root))).toBe(false);
    // The same image of two sides stands elsewhere for each.
    const image = [hash(77), 100] as const;
    const round = trees({ ...TREE, impostors: [{ rows: 96, images: [image, image, image, image] }] });
    hold(new Set(round.boards));
    const [south, east] = [plan(round.root), plan(round.root, { eye: [50, 0.5, 0.5] })];
    expect(south.instances.map(({ form }) => form.mesh)).toEqual(east.instances.map(({ form }) => form.mesh));
    expect(samePlan(south, east)).toBe(false);
  });

  it("draws none where the cell is there", () => {
    const { root, cells, boards, drawn } = trees();
    hold([...boards, ...tilesOf(cells.get("0/0/0/0")!)]);
    expect(drawn(plan(root))).toEqual([]);
  });
});

it("boards that are on their way are wanted until their cells are there, and none is asked for", () => {
  const { root, cells, boards } = trees();
  const wanted = (): (number | undefined)[] => {
    const seen = view(AFAR);
    const all = listWants([root], makePlan([root], DIRECTIONS, seen), MANIFEST, seen);
    const wants = new Map(all.map((want) => [want.resource, want.urgency]));
    return boards.map((board) => wants.get(board));
  };
  boards[1]!.state = "fetched";
  boards[2]!.state = "held";
  expect(wanted()).toEqual([undefined, URGENCY.seen, undefined, undefined]);
  for (const cell of cells.values()) hold(tilesOf(cell));
  expect(wanted()[1]).toBeUndefined();
});

describe("what is drawn of a board", () => {
  const level = (width: number, height: number): Level => ({ pixels: new Uint8ClampedArray(width * height * 4), width, height });
  const decoded: string[] = [];
  const pool = {
    decode: (kind: string, _: Uint8Array, where: string) => {
      decoded.push(`${kind} ${where}`);
      return Promise.resolve([level(4, 8), level(2, 4), level(1, 2), level(1, 1)]);
    },
  } as unknown as DecodePool;

  it("is two triangles that show its image, lit as a body", async () => {
    const texture = await cutoutOf(pool, new Uint8Array(9), "texture/1", new AbortController().signal);
    expect(decoded).toEqual(["cutout texture/1"]);
    const { parts: [part], placements, bytes, dispose } = boardModel(texture, 4);
    expect(part!.surface).toEqual({ map: texture, factor: [1, 1, 1, 1], cutoff: 0.5, unlit: false, colored: false });
    expect(texture).toMatchObject({ wrapS: ClampToEdgeWrapping, wrapT: ClampToEdgeWrapping, anisotropy: 4 });
    expect(texture).toMatchObject({ colorSpace: SRGBColorSpace, flipY: false });
    const of = (name: string): number[] => [...(part!.geometry.getAttribute(name) as BufferAttribute).array];
    expect(of("position")).toEqual([0.5, 0, -0.5, -0.5, 0, -0.5, -0.5, 0, 0.5, 0.5, 0, 0.5]);
    // The first row of the image is at the top.
    expect(of("uv")).toEqual([1, 1, 0, 1, 0, 0, 1, 0]);
    const [side, out] = [0.6 / Math.sqrt(1.72), 1 / Math.sqrt(1.72)];
    expect(of("normal")).toEqual([side, out, -side, -side, out, -side, -side, out, side, side, out, side].map((n) => expect.closeTo(n, 6)));
    expect([part!.triangles, part!.geometry.index!.count, placements]).toEqual([2, 6, []]);
    expect(bytes).toBeGreaterThan(4 * 8 * 4);
    let gone = 0;
    texture.addEventListener("dispose", () => gone++);
    part!.geometry.addEventListener("dispose", () => gone++);
    dispose();
    expect(gone).toBe(2);
  });

  it("is given from the shelf when it is found to be drawn by itself", () => {
    const shelf = new TextureShelf({} as Servers, pool, () => 1);
    const board = new Resource(`texture/${hash(5)}`, "impostor", 3, null);
    shelf.put(`texture/${hash(4)}`, new Uint8Array(4));
    shelf.put(board.key, new Uint8Array([1, 2, 3]));
    expect(shelf.keys()).toHaveLength(2);
    expect(shelf.taken((key) => (key === board.key ? board : null))).toEqual([[board, new Uint8Array([1, 2, 3])]]);
    expect(shelf.keys()).toEqual([`texture/${hash(4)}`]);
    expect(shelf.taken(() => null)).toEqual([]);
  });
});
