import { BoxGeometry, BufferAttribute } from "three";
import { describe, expect, it } from "vitest";
import { AttributeTables, decodeAttributeIndex, decodeAttributeTable } from "../src/core/attributes.js";
import { crc32 } from "../src/core/crc32.js";
import { FarfieldError } from "../src/core/errors.js";
import { decodeObjectTile, objectAt, type ObjectTile } from "../src/core/orthoview/objects.js";
import { candidatesAt } from "../src/core/picking/candidates.js";
import { CellObjects } from "../src/core/picking/objects.js";
import { pointOf, rayThrough, type Ray } from "../src/core/picking/ray.js";
import { HOLE } from "../src/core/holes.js";
import { makePlan, type Plan } from "../src/core/plan.js";
import { Recent } from "../src/core/recent.js";
import type { Servers } from "../src/core/servers.js";
import type { Found } from "../src/core/source.js";
import type { Vector3 } from "../src/core/vector.js";
import { featureOf, featuresOf } from "../src/three/near/features.js";
import { geometryHit } from "../src/three/near/hits.js";
import type { NearModel } from "../src/three/near/model.js";
import { sealed } from "./fuzz/shells.js";
import { listVectors, readJson, readVector } from "./vectors.js";
import { DIRECTIONS, GRID, hold, makeWorld, MANIFEST, tilesOf, view } from "./worlds.js";

const NEVER = new AbortController().signal;
const textOf = (value: unknown): Uint8Array => new TextEncoder().encode(JSON.stringify(value));

/** A server that has these values; it notes what it was asked for. */
function serving(values: Readonly<Record<string, Uint8Array>>): { servers: Pick<Servers, "of">; asked: string[] } {
  const asked: string[] = [];
  const get = (key: string): Promise<Uint8Array> => {
    asked.push(key);
    const value = values[key];
    return value ? Promise.resolve(value) : Promise.reject(new FarfieldError("missing", "not there", key));
  };
  const getMany = (keys: readonly string[]): Promise<Found[]> => {
    asked.push(...keys);
    return Promise.resolve(keys.map((key) => values[key] ?? null));
  };
  return { asked, servers: { of: () => ({ get, getMany }) } as unknown as Pick<Servers, "of"> };
}

describe("object ids of orthoview tiles written by Python", () => {
  interface Expected {
    readonly width: number;
    readonly height: number;
    readonly crc32: { readonly objects: number };
  }
  const NAMES = ["tiles", "tiles/deflated"].flatMap((folder) => listVectors(folder, ".ffid").map((name) => `${folder}/${name.replace(".ffid", "")}`));
  const read = (name: string): ObjectTile => decodeObjectTile(readVector(`${name}.ffov`), readVector(`${name}.ffid`), name);

  it.each(NAMES)("%s decode to the same", (name) => {
    const { width, height, crc32: sums } = readJson<Expected>(`${name}.json`);
    const { position, ids } = read(name);
    const plane = new Uint32Array(width * height);
    position.forEach((place, k) => (plane[(place >>> 12) * width + (place & 4095)] = ids[k]!));
    expect(crc32(new Uint8Array(plane.buffer))).toBe(sums.objects);
  });

  it.each(NAMES)("%s are refused when damaged, cut short or another tile's", (name) => {
    const [tile, ids] = [readVector(`${name}.ffov`), readVector(`${name}.ffid`)];
    const refuses = (other: Uint8Array): void => expect(() => decodeObjectTile(tile, other, "ids")).toThrow(expect.objectContaining({ tag: "corrupt" }));
    for (const length of [0, 1, 39, 40, 47, ids.length - 1]) refuses(ids.subarray(0, length));
    const changed = (at: number, value: number): Uint8Array => sealed(ids.map((byte, n) => (n === at ? value : byte)));
    // Place, size and number of pixels.
    for (const at of [12, 16, 20, 22, 28]) refuses(changed(at, ids[at]! ^ 1));
    // The plane's kind, and WebP for its codec.
    refuses(changed(40, 6));
    refuses(changed(41, 2));
    const short = ids.slice(0, -2);
    short[44] = ids[44]! - 2;
    refuses(sealed(short));
    refuses(tile);
    for (const other of NAMES) if (other.split("/").at(-1) !== name.split("/").at(-1)) refuses(readVector(`${other}.ffid`));
  });

  it("tell the nearest pixel of a place", () => {
    const tile = { position: Uint32Array.of(3 | (2 << 12), 4 | (2 << 12), 3 | (3 << 12)), depths: Uint16Array.of(80, 800, 88), ids: Uint32Array.of(7, 8, 9) } as unknown as ObjectTile;
    expect(objectAt(tile, [3.5, 2.5, 10])).toEqual({ id: 7, away: 0 });
    expect(objectAt(tile, [3.9, 2.5, 100])!.id).toBe(8);
    expect(objectAt(tile, [4.1, 2.5, 10.5])!.id).toBe(7);
    expect(objectAt(tile, [3.5, 5.4, 11])).toEqual({ id: 9, away: expect.closeTo(1.9) as number });
    expect(objectAt(tile, [9, 9, 10])).toBeNull();
    expect(objectAt(tile, [-1e300, NaN, 10])).toBeNull();
  });
});

describe("attributes", () => {
  const [INDEX, FIRST, SECOND] = ["00000000000000aa", "00000000000000bb", "00000000000000cc"];
  const VALUES = {
    [`attributes/${INDEX}`]: textOf({ objects: 9, parts: [[1, 2, FIRST], [4097, 3, SECOND]], later: 1 }),
    [`attributes/${FIRST}`]: textOf({ columns: { name: ["a", null], storeys: [3, 4.5] } }),
    [`attributes/${SECOND}`]: textOf({ columns: { __proto__: ["x", "y", "z"], listed: [null, true, false] } }),
  };

  it("are those of the object's row, each table fetched once", async () => {
    const { servers, asked } = serving(VALUES);
    const tables = new AttributeTables(servers);
    expect(await tables.of(1, INDEX!, NEVER)).toEqual({ name: "a", storeys: 3 });
    expect(await tables.of(2, INDEX!, NEVER)).toEqual({ storeys: 4.5 });
    expect(await tables.of(4099, INDEX!, NEVER)).toMatchObject({ listed: false });
    for (const id of [3, 4096, 4100, 2 ** 32 - 1]) expect(await tables.of(id, INDEX!, NEVER)).toEqual({});
    expect(await tables.of(1, null, NEVER)).toEqual({});
    expect(asked).toEqual([INDEX, FIRST, SECOND].map((hash) => `attributes/${hash}`));
  });

  it("a member called __proto__ is one like any other", () => {
    const text = new TextEncoder().encode('{"columns": {"__proto__": ["x"]}}');
    expect([...decodeAttributeTable(text, "table")]).toEqual([["__proto__", ["x"]]]);
  });

  it("that are missing, or no longer wanted, are errors", async () => {
    const tables = new AttributeTables(serving({ [`attributes/${INDEX}`]: VALUES[`attributes/${INDEX}`]! }).servers);
    await expect(tables.of(1, INDEX!, NEVER)).rejects.toMatchObject({ tag: "missing" });
    await expect(new AttributeTables(serving(VALUES).servers).of(1, INDEX!, AbortSignal.abort())).rejects.toMatchObject({ tag: "aborted" });
  });

  it.each<[string, unknown]>([
    ["no object", []], ["no count", { parts: [] }], ["no list", { objects: 1, parts: {} }], ["a part of two", { objects: 1, parts: [[1, 2]] }],
    ["id 0", { objects: 1, parts: [[0, 2, FIRST]] }], ["half a count", { objects: 1, parts: [[1, 1.5, FIRST]] }], ["a hash that leads elsewhere", { objects: 1, parts: [[1, 2, "../../secret0000"]] }],
    ["parts that overlap", { objects: 1, parts: [[1, 2, FIRST], [2, 2, FIRST]] }], ["ids beyond all", { objects: 1, parts: [[2 ** 32 - 2, 3, FIRST]] }],
  ])("an index with %s is refused", (_, index) => {
    expect(() => decodeAttributeIndex(textOf(index), "index")).toThrow(expect.objectContaining({ tag: "corrupt", where: "index" }));
  });

  it.each<[string, unknown]>([
    ["no columns", {}], ["a list", { columns: [] }], ["a column that is none", { columns: { a: "bcd" } }], ["columns of two lengths", { columns: { a: [1], b: [1, 2] } }],
  ])("a table with %s is refused", (_, table) => {
    expect(() => decodeAttributeTable(textOf(table), "table")).toThrow(expect.objectContaining({ tag: "corrupt", where: "table" }));
  });

  it.each<[string, unknown]>([["too few rows", ["a"]], ["a list", ["a", ["b"]]], ["an object", ["a", {}]]])("a row of %s is refused", async (_, name) => {
    const { servers } = serving({ ...VALUES, [`attributes/${FIRST}`]: textOf({ columns: { name } }) });
    await expect(new AttributeTables(servers).of(2, INDEX!, NEVER)).rejects.toMatchObject({ tag: "corrupt" });
  });

  it("no JSON is refused", () => {
    for (const read of [decodeAttributeIndex, decodeAttributeTable]) expect(() => read(Uint8Array.of(123, 255), "x")).toThrow(expect.objectContaining({ tag: "corrupt" }));
  });
});

describe("what was asked for last", () => {
  it("is kept within its room", () => {
    const recent = new Recent<number>(10);
    recent.add("a", 1, 4);
    recent.add("b", 2, 4);
    expect(recent.get("a")).toBe(1);
    recent.add("c", 3, 4);
    expect([recent.get("a"), recent.get("b"), recent.get("c")]).toEqual([1, undefined, 3]);
    expect(recent.add("d", 4, 99)).toBe(4);
    expect([recent.get("a"), recent.get("c"), recent.get("d")]).toEqual([undefined, undefined, 4]);
  });
});

describe("a ray", () => {
  it("leads through the place of the picture that it is of", () => {
    const looking = { eye: [1, 2, 3] as Vector3, toX: [100, 50, 0] as Vector3, toY: [0, 40, 90] as Vector3, toW: [0, 1, 0] as Vector3, near: 1, width: 100, height: 80 };
    const ray = rayThrough(looking, 30, 60);
    const [x, y, z] = pointOf(ray, 7);
    const c = [x - 1, y - 2, z - 3] as const;
    expect(c[1]).toBeCloseTo(7);
    expect((100 * c[0] + 50 * c[1]) / 7).toBeCloseTo(30);
    expect((40 * c[1] + 90 * c[2]) / 7).toBeCloseTo(60);
    expect(Math.hypot(...pointOf(ray, 7, 2).map((part, a) => part - [x, y, z][a]!))).toBeCloseTo(2);
  });
});

/** Straight down on a place. */
const down = (x: number, y: number): Ray => ({ eye: [x, y, 10], direction: [0, 0, -1] });

describe("cells that may show a point", () => {
  it("are the finest that hold it, then those beside it", () => {
    const { root, cells } = makeWorld();
    hold(tilesOf(root));
    hold(tilesOf(cells.get("0/0/0/0")!));
    const plan = makePlan([root], DIRECTIONS, view({ radius: 1e9 }));
    expect(plan.pictures.map(({ cell }) => cell.name).sort()).toEqual(["0/0/0/0", "2/0/0/0"]);
    const namesAt = (x: number, y: number): string[] => candidatesAt(plan, GRID, down(x, y), 9.5).map(({ cell }) => cell.name);
    expect(namesAt(0.5, 0.5)).toEqual(["0/0/0/0", "2/0/0/0"]);
    expect(namesAt(1.1, 0.5)).toEqual(["2/0/0/0", "0/0/0/0"]);
    expect(namesAt(3.5, 3.5)).toEqual(["2/0/0/0"]);
    expect(namesAt(99, 0)).toEqual([]);
  });

  it("on a face are those behind it", () => {
    const { root, cells } = makeWorld();
    for (const name of ["0/0/0/0", "0/1/0/0"]) hold(tilesOf(cells.get(name)!));
    const plan = makePlan([root], DIRECTIONS, view({ radius: 1e9 }));
    const firstAlong = (direction: Vector3): string => {
      const eye: Vector3 = [1 - 5 * direction[0], 0.5, 0.5];
      return candidatesAt(plan, GRID, { eye, direction }, 5)[0]!.cell.name;
    };
    expect(firstAlong([1, 0, 0])).toBe("0/1/0/0");
    expect(firstAlong([-1, 0, 0])).toBe("0/0/0/0");
  });

  it("that go behind finer ones have it where they are", () => {
    const { root } = makeWorld();
    const plan = { pictures: [{ cell: root, tiles: tilesOf(root), holes: HOLE, share: 1, behind: true } as const], solids: [] };
    expect(candidatesAt(plan, GRID, down(2, 2), 9.5)[0]!.distance).toBe(9.5 - GRID.pitch(2));
  });
});

describe("objects of cells", () => {
  it("of a world without ids are none, after one question", async () => {
    const { root } = makeWorld();
    hold(tilesOf(root));
    const tile = readVector("tiles/row.ffov");
    const { servers, asked } = serving(Object.fromEntries(tilesOf(root).map(({ key }) => [key, tile])));
    const objects = new CellObjects(servers, MANIFEST);
    const candidate = { cell: root, by: "orthoview", drawn: tilesOf(root), distance: 9.5 } as const;
    for (let n = 0; n < 2; n++) expect(await objects.at(candidate, down(2, 2), NEVER)).toBe(0);
    // That which looks along the ray.
    expect(asked).toEqual(["orthoview/2/0/0/0/22/0-00", "objects/2/0/0/0/22/0-00"]);
    await expect(new CellObjects(servers, MANIFEST).at(candidate, down(2, 2), AbortSignal.abort())).rejects.toMatchObject({ tag: "aborted" });
  });

  it("are those of the pixels that lie where a ray meets them, whatever the cell is drawn by", async () => {
    const { root } = makeWorld();
    const vertical = DIRECTIONS.get(22)!;
    const level = (bytes: Uint8Array): Uint8Array => sealed(bytes.map((byte, n) => (n === 8 ? root.level : byte)));
    const [tile, ids] = ["ffov", "ffid"].map((ending) => level(readVector(`tiles/noise.${ending}`))) as [Uint8Array, Uint8Array];
    const { servers } = serving({ "orthoview/2/0/0/0/22/0-00": tile, "objects/2/0/0/0/22/0-00": ids });
    const objects = new CellObjects(servers, MANIFEST);
    const known = decodeObjectTile(tile, ids, "noise");
    const pitch = GRID.pitch(2);
    const { u, v, w } = vertical.axes;
    for (let k = 0; k < known.ids.length; k += 9) {
      const [column, row] = [known.position[k]! & 4095, known.position[k]! >>> 12];
      const along = [known.x + column + 0.5, known.y + row + 0.5, (known.depthBase + known.depths[k]!) / 8].map((part) => part * pitch) as unknown as Vector3;
      const at = (a: number): number => along[0] * u[a]! + along[1] * v[a]! + along[2] * w[a]! - 5 * w[a]!;
      const ray: Ray = { eye: [at(0), at(1), at(2)], direction: w };
      for (const by of ["orthoview", "geometry"] as const) {
        const drawn = by === "orthoview" ? tilesOf(root) : [];
        expect(await objects.at({ cell: root, by, drawn, distance: 5 }, ray, NEVER)).toBe(known.ids[k]);
      }
    }
    const beside: Ray = { eye: [0, 0, 0], direction: w };
    const { servers: half } = serving({ "orthoview/2/0/0/0/22/0-00": tile, "objects/2/0/0/0/22/0-00": ids, "objects/2/0/0/0/14/0-00": ids });
    await expect(new CellObjects(half, MANIFEST).at({ cell: root, by: "orthoview", drawn: [], distance: 5 }, beside, NEVER)).rejects.toMatchObject({ tag: "missing" });
  });

  it("of BlockMaps are those of the texel behind a wall", async () => {
    const { object_ids: text, objects } = readJson<{ object_ids: string; objects: string }>("blockmaps/small-by-area.json");
    expect(objects).not.toBe("");
    const { root } = makeWorld({ tiles: [], blockmap: { hash: "00000000000000dd", bytes: 99 } } as never);
    const key = "objects/2/0/0/0/blockmap-00000000000000dd";
    const { servers, asked } = serving({ [key]: new Uint8Array(Buffer.from(text, "base64")) });
    const found = new CellObjects(servers, MANIFEST);
    const drawn = tilesOf(root).length > 0 ? tilesOf(root) : [root.blockmap!.leaf];
    expect(drawn.map(({ kind }) => kind)).toEqual(["blockmap"]);
    const idAt = (ray: Ray, distance: number) => found.at({ cell: root, by: "blockmap", drawn, distance }, ray, NEVER);
    const { decodeBlockMapObjects } = await import("../src/core/blockmap/objects.js");
    const ids = decodeBlockMapObjects(new Uint8Array(Buffer.from(text, "base64")), "ids");
    const n = Math.sqrt(ids.length);
    const [width, seen] = [4 / n, new Set<number>()];
    for (let j = 0; j < n; j++) {
      for (let i = 0; i < n; i++) {
        const id = ids[j * n + i]!;
        if (id === 0) continue;
        seen.add(id);
        expect(await idAt(down((i + 0.5) * width, (j + 0.5) * width), 9.5)).toBe(id);
        // Its west side, from the west, and its east side, from the east.
        expect(await idAt({ eye: [i * width - 3, (j + 0.5) * width, 0.5], direction: [1, 0, 0] }, 3)).toBe(id);
        expect(await idAt({ eye: [(i + 1) * width + 3, (j + 0.5) * width, 0.5], direction: [-1, 0, 0] }, 3)).toBe(id);
      }
    }
    expect(seen.size).toBeGreaterThan(1);
    expect(asked).toEqual([key]);
  });
});

describe("hits of geometry", () => {
  /** A box of 12 triangles, two a side, each side a feature; from 0.1 to 0.5 along z. */
  function modelOf(changes: Partial<NearModel> = {}): NearModel {
    const geometry = new BoxGeometry(0.4, 0.4, 0.4).translate(0, 0, 0.3);
    const features = Uint8Array.from({ length: 12 }, (_, n) => n >> 1);
    const surface = { map: null, factor: [1, 1, 1, 1], cutoff: 0, unlit: false, colored: false } as const;
    return { parts: [{ geometry, surface, triangles: 12, features }], placements: [], objects: null, bytes: 0, dispose: () => undefined, ...changes };
  }

  function planOf(model: NearModel, shared: NearModel | null = null): Plan {
    const { root, cells } = makeWorld();
    const leaf = cells.get("0/1/1/0")!;
    const form = leaf.forms[0]!;
    form.leaf.payload = model;
    hold([form.leaf]);
    const mesh = Object.assign(Object.create(form.leaf) as typeof form.leaf, { key: "mesh/aa", payload: shared });
    const plan = makePlan([root], DIRECTIONS, view({ radius: 1e9, near: 1e9 }));
    return { ...plan, geometry: [{ ...form, meshes: shared ? [mesh] : [] }] };
  }

  const objects = Uint32Array.of(100, 101, 102, 103, 104, 105);

  it("are of the triangle at that distance, not of those before it", () => {
    const plan = planOf(modelOf({ objects }));
    const ray: Ray = { eye: [1.05, 1.05, 10], direction: [0, 0, -1] };
    // The sides of the box are +x, -x, +y, -y, +z, -z.
    expect(geometryHit(plan, GRID, ray, 9.5)).toEqual({ id: 104, corner: [1, 1, 0] });
    expect(geometryHit(plan, GRID, ray, 9.9)).toEqual({ id: 105, corner: [1, 1, 0] });
    expect(geometryHit(plan, GRID, ray, 9.7)).toBeNull();
    expect(geometryHit(plan, GRID, { eye: [6, 1.1, 0.2], direction: [-1, 0, 0] }, 4.8)).toMatchObject({ id: 100 });
    expect(geometryHit(plan, GRID, { ...ray, eye: [1.5, 1.5, 10] }, 9.5)).toBeNull();
  });

  it("of instances count from their own ids", () => {
    // Turned about z and twice as large.
    const place = [0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 0.5, 0.5, 0, 1];
    const transforms = Float32Array.from([...place, ...new Array<number>(16).fill(0)]);
    const plan = planOf(modelOf({ parts: [], placements: [{ mesh: "aa", transforms, objects: Uint32Array.of(4097, 9) }] }), modelOf());
    expect(geometryHit(plan, GRID, down(1.6, 1.6), 9)).toMatchObject({ id: 4097 + 4 });
    expect(geometryHit(plan, GRID, { eye: [1.5, 9, 0.3], direction: [0, -1, 0] }, 7.1)).toMatchObject({ id: 4097 });
  });

  it("of triangles know their feature in as few bytes as it takes", () => {
    const geometry = new BoxGeometry();
    const told = (of: (n: number) => number) => {
      geometry.setAttribute("_feature_id_0", new BufferAttribute(Float32Array.from({ length: 24 }, (_, n) => of(n)), 1));
      return featuresOf(geometry, 12);
    };
    expect(featuresOf(geometry, 12)).toBe(0);
    expect(told(() => 7)).toBe(7);
    expect(told((n) => n >> 2)).toEqual(Uint8Array.from({ length: 12 }, (_, n) => n >> 1));
    expect(told((n) => 300 * n)).toBeInstanceOf(Uint16Array);
    expect(told((n) => 70_000 + n)).toBeInstanceOf(Uint32Array);
    expect(told(() => NaN)).toBe(0);
    expect([featureOf(Uint8Array.of(3, 4), 1), featureOf(9, 1)]).toEqual([4, 9]);
  });
});
