import { createHash, randomBytes } from "node:crypto";
import { deflateRawSync } from "node:zlib";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Backoff } from "../src/core/backoff.js";
import type { Cell } from "../src/core/cell.js";
import { crc32 } from "../src/core/crc32.js";
import { Follower } from "../src/core/follower.js";
import { Grid } from "../src/core/grid.js";
import type { CellEntry } from "../src/core/indextile.js";
import { tagIn } from "../src/core/fetch.js";
import { decodeManifest, sameFrame, type Manifest } from "../src/core/manifest.js";
import { Server, Servers } from "../src/core/servers.js";
import type { Source } from "../src/core/source.js";
import { WorldIndex } from "../src/core/world.js";
import { Generations } from "../src/three/generations.js";
import { GRID, hold, MANIFEST, tilesOf, VIEWS } from "./worlds.js";

/** Hash of the tiles of each leaf `x y`; those not in it are not there. */
type Leaves = ReadonlyMap<string, string>;

const FIRST: Leaves = new Map(["0 0", "1 0", "0 1", "1 1", "2 2", "3 3"].map((place) => [place, "a"]));

/** Index tiles of a world of 4 x 4 leaves, three levels, two of them in a tile. Hashes say what lies below. */
function tilesFor(leaves: Leaves, padding: number): { root: string; tiles: Map<string, Uint8Array> } {
  const tiles = new Map<string, Uint8Array>();
  const below = (level: number, x: number, y: number): string => {
    const there = [...leaves].filter(([place]) => within(place, level, x, y));
    return there.length === 0 ? "" : hashOf(there.join());
  };
  const entry = (level: number, x: number, y: number): CellEntry => {
    const { lower, upper } = GRID.bounds({ level, x, y, z: 0 });
    const children = [0, 1, 2, 3].map((n) => [x * 2 + (n & 1), y * 2 + (n >> 1)] as const).filter(([u, v]) => level > 0 && below(level - 1, u, v));
    return {
      key: `${level}/${x}/${y}/0`, bounds: [lower, upper], error: 1, hash: below(level, x, y),
      tiles: VIEWS.map((direction) => [direction, 0, 1000] as const),
      views: new Array(26).fill(VIEWS), children: children.map(([u, v]) => `${level - 1}/${u}/${v}/0`),
      ...(level === 1 ? { index: below(level, x, y) } : {}),
      ...(level === 0 ? { geometry: { hash: hashOf(leaves.get(`${x} ${y}`)!), bytes: 9, triangles: 2, instances: 0, meshes: [[hashOf("m"), 5] as const] } } : {}),
    };
  };
  for (const x of [0, 1]) {
    for (const y of [0, 1]) {
      if (!below(1, x, y)) continue;
      const own = entry(1, x, y);
      const cells = [own, ...own.children!.map((name) => entry(0, ...(name.split("/").slice(1, 3).map(Number) as [number, number])))];
      tiles.set(`index/1/${x}/${y}/0-${own.index}`, encode(cells, padding));
    }
  }
  const root = entry(2, 0, 0);
  tiles.set(`index/2/0/0/0-${root.hash}`, encode([root, ...root.children!.map((name) => entry(1, ...(name.split("/").slice(1, 3).map(Number) as [number, number])))], padding));
  return { root: root.hash!, tiles };
}

function hashOf(text: string): string {
  return createHash("sha1").update(text).digest("hex").slice(0, 16);
}

function within(place: string, level: number, x: number, y: number): boolean {
  const [u, v] = place.split(" ").map(Number);
  return u! >> level === x && v! >> level === y;
}

/** `padding`: bytes that it is larger than it need be. */
function encode(cells: readonly CellEntry[], padding = 0): Uint8Array {
  const text = new TextEncoder().encode(JSON.stringify({ root: cells[0]!.key, cells, padding: randomBytes(padding).toString("base64") }));
  const packed = deflateRawSync(text);
  const bytes = new Uint8Array(16 + packed.length);
  const header = new DataView(bytes.buffer);
  header.setUint32(0, 0x58494646, true);
  header.setUint16(4, 1, true);
  header.setUint32(8, text.length, true);
  header.setUint32(12, crc32(text), true);
  bytes.set(packed, 16);
  return bytes;
}

/** Generations of that world on a server that notes what it is asked for. */
function makeServer(leaves = FIRST, padding = 0) {
  const asked: string[] = [];
  const values = new Map<string, Uint8Array>();
  const source: Source = {
    base: "", bytes: 0, requests: 0, batchKeys: 10, events: null, stream: null, tag: null,
    manifest: () => Promise.reject(new Error("unused")),
    knock: () => Promise.resolve(),
    get: () => Promise.reject(new Error("unused")),
    getMany: (keys) => {
      asked.push(...keys);
      return Promise.resolve(keys.map((key) => values.get(key) ?? null));
    },
  };
  const bad: string[] = [];
  const server = new Server(source, new Backoff(() => 0, () => undefined), new AbortController().signal, () => undefined, true);
  const servers = new Servers(server, MANIFEST, () => server);
  const manifestOf = (leaves: Leaves, generation: number): Manifest => {
    const { root, tiles } = tilesFor(leaves, padding);
    for (const [key, value] of tiles) values.set(key, value);
    return { ...MANIFEST, generation, roots: [{ key: { level: 2, x: 0, y: 0, z: 0 }, hash: root }] };
  };
  const first = new WorldIndex(manifestOf(leaves, 1), servers, { bad: (key) => void bad.push(key), grown: () => undefined });
  return { asked, bad, first, manifestOf };
}

function cellsOf(index: WorldIndex): Map<string, Cell> {
  const found = new Map<string, Cell>();
  const list = (cell: Cell): void => {
    found.set(cell.name, cell);
    cell.children?.forEach(list);
  };
  index.roots.forEach(list);
  return found;
}

async function readAll(index: WorldIndex): Promise<Map<string, Cell>> {
  for (let round = 0; round < 3; round++) {
    index.explore([...cellsOf(index).values()].filter(({ unread }) => unread));
    await new Promise((resolve) => setTimeout(resolve));
  }
  return cellsOf(index);
}

const changedLeaf = new Map([...FIRST, ["2 2", "b"]]);
const without = new Map([...FIRST].filter(([place]) => place !== "1 1"));

describe("WorldIndex.explore", () => {
  const everywhere: Leaves = new Map(["0 0", "2 0", "0 2", "2 2"].map((place) => [place, "a"]));
  const below = ["1/1/1/0", "1/0/0/0", "1/1/0/0", "1/0/1/0"];
  const read = async (padding: number, room?: number): Promise<{ index: WorldIndex; asked: readonly string[]; cells: Cell[] }> => {
    const { first, asked } = makeServer(everywhere, padding);
    first.explore(first.roots);
    await new Promise((resolve) => setTimeout(resolve));
    const cells = cellsOf(first);
    asked.length = 0;
    const listed = below.map((name) => cells.get(name)!);
    first.explore(listed, room);
    return { index: first, asked, cells: listed };
  };
  const names = (keys: readonly string[]): string[] => keys.map((key) => /index\/(.*)-/.exec(key)![1]!);

  it("asks for as much at once as the link has room for, by what tiles have had so far, the first first", async () => {
    const { index, asked } = await read(40_000);
    expect(names(asked)).toEqual(below.slice(0, 1));
    expect(index.pending).toBe(4);
    await new Promise((resolve) => setTimeout(resolve));
    expect(names(asked)).toEqual(below);
    expect(index.pending).toBe(0);
    expect(names((await read(40_000, 60_000)).asked)).toEqual(below.slice(0, 2));
    expect(names((await read(0)).asked)).toEqual(below);
  });

  it("leaves out what is not wanted any more", async () => {
    const { index, asked, cells } = await read(40_000);
    index.explore(cells.slice(3));
    await new Promise((resolve) => setTimeout(resolve));
    expect(names(asked)).toEqual([below[0], below[3]]);
    expect(index.pending).toBe(0);
  });
});

describe("WorldIndex.followedBy", () => {
  it("keeps what has not changed, and asks only for index tiles that have", async () => {
    const { asked, bad, first, manifestOf } = makeServer();
    const before = await readAll(first);
    for (const cell of before.values()) hold([...tilesOf(cell), ...(cell.geometry ? [cell.geometry.leaf] : [])]);
    asked.length = 0;
    const after = await readAll(first.followedBy(manifestOf(changedLeaf, 2)));
    expect(asked.map((key) => key.split("-")[0])).toEqual(["index/2/0/0/0", "index/1/1/1/0"]);
    expect([...after.keys()]).toEqual([...before.keys()]);
    for (const [name, cell] of after) {
      const changed = ["2/0/0/0", "1/1/1/0", "0/2/2/0"].includes(name);
      expect(tilesOf(cell).map((tile) => tile.held), name).toEqual([!changed, !changed, !changed]);
      expect(tilesOf(cell).every((tile) => tile.cell === cell), name).toBe(true);
      expect(tilesOf(before.get(name)!).every((tile) => tile.held), `${name} can still be drawn`).toBe(true);
      expect(tilesOf(before.get(name)!).every((tile) => tile.gone === changed), name).toBe(true);
    }
    expect(after.get("0/3/3/0")!.geometry!.leaf.held).toBe(true);
    expect(after.get("0/2/2/0")!.geometry!.leaf.held).toBe(false);
    expect(after.get("0/2/2/0")!.geometry!.meshes[0]).toBe(before.get("0/2/2/0")!.geometry!.meshes[0]);
    expect(bad).toEqual([]);
  });

  it("counts what is held below the new cells", async () => {
    const { first, manifestOf } = makeServer();
    const before = await readAll(first);
    hold(tilesOf(before.get("0/0/0/0")!));
    hold(tilesOf(before.get("0/3/3/0")!));
    hold(tilesOf(before.get("0/2/2/0")!));
    const after = await readAll(first.followedBy(manifestOf(changedLeaf, 2)));
    const held = Object.fromEntries([...after].map(([name, cell]) => [name, cell.heldBelow]));
    expect(held).toMatchObject({ "2/0/0/0": 6, "1/0/0/0": 3, "1/1/1/0": 3, "0/2/2/0": 0, "0/3/3/0": 3 });
    after.get("0/0/0/0")!.count(-1);
    expect(after.get("2/0/0/0")!.heldBelow).toBe(5);
  });

  it("has no cells that are gone, and new ones where there were none", async () => {
    const { first, manifestOf } = makeServer();
    const before = await readAll(first);
    const fewer = await readAll(first.followedBy(manifestOf(without, 2)));
    expect([...before.keys()].filter((name) => !fewer.has(name))).toEqual(["0/1/1/0"]);
    const more = await readAll(first.followedBy(manifestOf(new Map([...FIRST, ["3 0", "c"]]), 3)));
    expect([...more.keys()].filter((name) => !before.has(name))).toEqual(["1/1/0/0", "0/3/0/0"]);
  });

  it("takes everything over when only the manifest has changed", async () => {
    const { asked, first, manifestOf } = makeServer();
    const before = await readAll(first);
    asked.length = 0;
    const same = first.followedBy({ ...manifestOf(FIRST, 2), name: "another" });
    expect((await readAll(same)).get("0/0/0/0")).toBe(before.get("0/0/0/0"));
    expect(asked).toEqual([]);
  });

  it("follows before the one ahead has been read, and tries again what was bad", async () => {
    const { asked, first, manifestOf } = makeServer();
    const before = await readAll(first);
    hold(tilesOf(before.get("0/1/0/0")!));
    tilesOf(before.get("0/3/3/0")!)[0]!.state = "bad";
    const unread = first.followedBy(manifestOf(without, 2));
    unread.close();
    asked.length = 0;
    const after = await readAll(unread.followedBy(manifestOf(changedLeaf, 3)));
    expect(asked.map((key) => key.split("-")[0])).toEqual(["index/2/0/0/0", "index/1/1/1/0"]);
    expect(tilesOf(after.get("0/1/0/0")!)[0]!.held).toBe(true);
    expect(tilesOf(after.get("0/3/3/0")!)[0]!.state).toBe("absent");
  });
});

describe("sameFrame", () => {
  it("tells worlds whose cells have other places", () => {
    expect(sameFrame(MANIFEST, { ...MANIFEST, generation: 2, name: "x", credits: ["y"], bounds: { lower: [0, 0, 0], upper: [1, 1, 1] } })).toBe(true);
    for (const grid of [new Grid(2, 16, [0, 0, 0], [2, 2, 0]), new Grid(1, 32, [0, 0, 0], [2, 2, 0]), new Grid(1, 16, [1, 0, 0], [2, 2, 0]), new Grid(1, 16, [0, 0, 0], [3, 2, 0])]) {
      expect(sameFrame(MANIFEST, { ...MANIFEST, grid })).toBe(false);
    }
    expect(sameFrame(MANIFEST, { ...MANIFEST, directions: new Map([...MANIFEST.directions].slice(1)) })).toBe(false);
    expect(sameFrame(MANIFEST, { ...MANIFEST, origin: [1024, 0, 0] })).toBe(false);
    expect(sameFrame(MANIFEST, { ...MANIFEST, servers: { level: 1, addresses: ["../a/"] } })).toBe(false);
  });
});

class FakeStream extends EventTarget {
  static made: FakeStream[] = [];
  readyState = 1;

  constructor() {
    super();
    FakeStream.made.push(this);
  }

  close(): void {
    this.readyState = 2;
  }

  say(data: string): void {
    this.dispatchEvent(new MessageEvent("generation", { data }));
  }
}

const page = Object.assign(new EventTarget(), { hidden: false });

/** As in a browser: a page in sight, and streams of events. */
function inBrowser(): void {
  beforeEach(() => {
    FakeStream.made = [];
    page.hidden = false;
    vi.stubGlobal("EventSource", FakeStream);
    vi.stubGlobal("document", page);
  });
  afterEach(() => void vi.unstubAllGlobals());
}

describe("Follower", () => {
  inBrowser();
  const show = (shown: boolean): void => {
    page.hidden = !shown;
    page.dispatchEvent(new Event("visibilitychange"));
  };

  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => void vi.useRealTimers());

  it("hears of manifests and nothing else", () => {
    const heard: string[] = [];
    const follower = new Follower(new URL("http://world.test/events"), (tag) => void heard.push(tag));
    const [stream] = FakeStream.made;
    for (const text of ['{"manifest": "a"}', "{", "null", '{"generation": 4}', '{"manifest": 5}', '{"generation": 1, "manifest": "b"}']) stream!.say(text);
    expect(heard).toEqual(["a", "b"]);
    follower.close();
    expect(stream!.readyState).toBe(2);
    show(true);
    expect(FakeStream.made).toHaveLength(1);
  });

  it("holds no connection while the page is hidden", () => {
    const follower = new Follower(new URL("http://world.test/events"), () => undefined);
    show(false);
    expect(FakeStream.made.map(({ readyState }) => readyState)).toEqual([2]);
    show(true);
    expect(FakeStream.made.map(({ readyState }) => readyState)).toEqual([2, 1]);
    follower.close();
  });

  it("tries again half a minute after a refusal", () => {
    const follower = new Follower(new URL("http://world.test/events"), () => undefined);
    FakeStream.made[0]!.dispatchEvent(new Event("error"));
    expect(FakeStream.made).toHaveLength(1);
    FakeStream.made[0]!.close();
    FakeStream.made[0]!.dispatchEvent(new Event("error"));
    vi.advanceTimersByTime(29_000);
    expect(FakeStream.made).toHaveLength(1);
    vi.advanceTimersByTime(2000);
    expect(FakeStream.made).toHaveLength(2);
    follower.close();
  });
});

describe("Generations", () => {
  inBrowser();
  const textOf = (name: string): string => JSON.stringify({
    format: "farfield-world", version: 1, generation: 1, name, bounds: [[0, 0, 0], [1, 1, 1]], directions: [],
    grid: { leaf_size: 1, resolution: 16, corner: [0, 0, 0], axis_levels: [0, 0, 0] },
  });

  it("reads the manifest that is told of and not known, and finds one that differs, whatever its number", async () => {
    let [text, tag, reads] = [textOf("first"), "a", 0];
    const source = {
      base: "http://world.test/", bytes: 0, requests: 0, batchKeys: 10, events: new URL("http://world.test/events"),
      stream: null,
      get tag() { return tag; },
      manifest: () => Promise.resolve((reads++, text)),
      knock: () => Promise.resolve(),
      get: () => Promise.reject(new Error("unused")),
      getMany: () => Promise.reject(new Error("unused")),
    } satisfies Source;
    let newest = decodeManifest(text, "");
    const found: string[] = [];
    const { signal } = new AbortController();
    const home = new Server(source, new Backoff(() => 0, () => undefined), signal, () => undefined, true);
    const generations = new Generations({
      home, signal, newest: () => newest,
      found: (manifest) => found.push((newest = manifest).name), unreadable: () => expect.unreachable(),
    });
    const hear = async (manifest: string): Promise<void> => {
      FakeStream.made[0]!.say(JSON.stringify({ generation: 1, manifest }));
      await new Promise((resolve) => setTimeout(resolve));
    };
    await hear("a");
    expect([reads, found]).toEqual([0, []]);
    await hear("b");
    expect([reads, found]).toEqual([1, []]);
    [text, tag] = [textOf("baked from nothing"), "c"];
    await hear("d");
    expect([reads, found]).toEqual([2, ["baked from nothing"]]);
    generations.close();
  });
});

describe("tagIn", () => {
  it("reads the ETags of farfield serve, and no others", () => {
    const tag = "0123456789abcdef";
    expect([`"${tag}"`, `"${tag}-gz"`, `W/"${tag}"`, `W/"${tag}-gz"`].map(tagIn)).toEqual([tag, tag, tag, tag]);
    expect([null, "", tag, `"${tag}-br"`, '"5f3-62"', '""'].map(tagIn)).toEqual([null, null, null, null, null, null]);
  });
});
