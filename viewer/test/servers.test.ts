import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Backoff, type Connection } from "../src/core/backoff.js";
import { FarfieldError } from "../src/core/errors.js";
import { Fetcher } from "../src/core/fetch.js";
import { formatKey, Grid } from "../src/core/grid.js";
import { Loader, type Preparer } from "../src/core/loader.js";
import { decodeManifest } from "../src/core/manifest.js";
import { Resource } from "../src/core/resource.js";
import { isAddress, serverOf, type ServerRule } from "../src/core/serverrule.js";
import { Server, Servers } from "../src/core/servers.js";
import type { Vector3 } from "../src/core/vector.js";
import { listWants, type Want } from "../src/core/wants.js";
import { makePlan } from "../src/core/plan.js";
import { TextureShelf } from "../src/three/near/textures.js";
import { listVectors, readJson } from "./vectors.js";
import { DIRECTIONS, GRID, hold, makeWorld, MANIFEST, tilesOf, view } from "./worlds.js";

/** What scripts/write_server_vectors.py writes. */
interface Vectors {
  readonly grid: { leaf_size: number; resolution: number; corner: Vector3; axis_levels: Vector3 };
  readonly servers: ServerRule;
  readonly keys: readonly (readonly [string, number | null])[];
}

describe("serverOf", () => {
  it.each(listVectors("servers", ".json").filter((name) => name !== "addresses.json"))("gives what Python gives: %s", (name) => {
    const { grid, servers, keys } = readJson<Vectors>(`servers/${name}`);
    const there = new Grid(grid.leaf_size, grid.resolution, grid.corner, grid.axis_levels);
    expect(keys.map(([key]) => [key, serverOf(key, servers, there)])).toEqual(keys);
  });

  it("knows the addresses that Python knows", () => {
    const addresses = readJson<[string, boolean][]>("servers/addresses.json");
    expect(addresses.map(([address]) => [address, isAddress(address)])).toEqual(addresses);
  });
});

describe("a manifest with servers", () => {
  const GOOD = { rule: "cell-crc32", level: 1, addresses: ["https://a.example.org/", "../b/"] };
  const read = (servers: unknown) =>
    decodeManifest(
      JSON.stringify({
        format: "farfield-world", version: 1, bounds: [[0, 0, 0], [8, 8, 2]], directions: [], servers,
        grid: { leaf_size: 4, resolution: 64, corner: [-1, -1, -1], axis_levels: [2, 2, 0] },
      }),
      "here",
    );

  it("is read", () => {
    expect(read({ ...GOOD, later: 1 }).servers).toEqual({ level: 1, addresses: GOOD.addresses });
    expect(read(undefined).servers).toBeNull();
  });

  it.each([
    null, [], "a", {}, { ...GOOD, rule: null }, { ...GOOD, rule: undefined }, { ...GOOD, level: -1 }, { ...GOOD, level: 41 }, { ...GOOD, level: 1.5 },
    { ...GOOD, addresses: [] }, { ...GOOD, addresses: ["../a/", "../a/"] }, { ...GOOD, addresses: ["../a/", 1] },
    { ...GOOD, addresses: ["/etc/"] }, { ...GOOD, addresses: ["javascript:alert(1)/"] }, { ...GOOD, addresses: ["https://user:secret@a.example.org/"] },
    { ...GOOD, addresses: Array.from({ length: 257 }, (_, n) => `../${n}/`) },
  ])("is refused when damaged: %j", (servers) => {
    expect(() => read(servers)).toThrow(expect.objectContaining({ tag: "not-a-world", where: "here" }));
  });

  it("is refused by its rule when a later version has split the world", () => {
    const later = { tag: "version", what: expect.stringContaining('by the rule "hilbert"'), hint: "upgrade farfield" };
    expect(() => read({ rule: "hilbert", shards: 3 })).toThrow(expect.objectContaining(later));
  });
});

const HOME = "http://home.test/city/";
const RULE: ServerRule = { level: 0, addresses: ["http://a.test/", "http://b.test/city/", "../c/"] };
const BASES = ["http://a.test/", "http://b.test/city/", "http://home.test/c/"];

type Answer = (url: URL, init: RequestInit) => Response | Promise<Response>;

/** Answers fetch; returns the addresses asked for, knocks as such. */
function serve(answer: Answer): string[] {
  const asked: string[] = [];
  vi.stubGlobal("fetch", (url: URL, init: RequestInit) => {
    asked.push(`${init.method === "HEAD" ? "knock " : ""}${url.href}`);
    return new Promise<Response>((resolve, reject) => {
      init.signal?.addEventListener("abort", () => reject(new DOMException("stopped", "AbortError")));
      Promise.resolve().then(() => answer(url, init)).then(resolve, reject);
    });
  });
  return asked;
}

const bytes = (count = 100) => new Response(new Uint8Array(count));
const refused = () => Promise.reject(new TypeError("failed to fetch"));

function makeServers(rule: ServerRule | null = RULE) {
  const connections: (Connection & { at: string })[] = [];
  const hooks = { back: (): void => undefined };
  const make = (address: string, signal: AbortSignal, known = false): Server => {
    const backoff = new Backoff(() => performance.now(), (connection) => connections.push({ ...connection, at: address }));
    return new Server(new Fetcher(address), backoff, signal, () => hooks.back(), known);
  };
  const home = make(HOME, new AbortController().signal, true);
  const servers = new Servers(home, { grid: GRID, servers: rule }, make);
  return { servers, home, connections, hooks };
}

function makeLoader(prepare?: Preparer["prepare"], rule: ServerRule | null = RULE) {
  const made = makeServers(rule);
  const bad: string[] = [];
  const preparer: Preparer = {
    prepare: prepare ?? ((_, found) => Promise.resolve({ size: found.length, install: () => found })),
    dispose: () => undefined,
  };
  const loader = new Loader(made.servers, preparer, 1e6, { bad: ({ key }) => void bad.push(key), arrived: () => undefined });
  made.hooks.back = () => loader.pump();
  return { ...made, loader, bad };
}

/** Tiles of the 16 leaves: with three servers each has some. */
const leaves = (): Resource[] =>
  Array.from({ length: 16 }, (_, n) => formatKey({ level: 0, x: n % 4, y: n >> 2, z: 0 })).flatMap((cell) =>
    [4, 14, 22].map((direction) => new Resource(`orthoview/${cell}/${direction}/0-0123456789abcdef`, "orthoview", 1000, null)),
  );
const numberOf = ({ key }: Resource): number => serverOf(key, RULE, GRID)!;
const want = (resource: Resource): Want => ({ resource, urgency: 1, distance: 0, level: 0 });
const statesAt = (list: readonly Resource[], number: number) => new Set(list.filter((one) => numberOf(one) === number).map(({ state }) => state));

describe("Servers", () => {
  beforeEach(() => void vi.useFakeTimers());
  afterEach(() => {
    vi.useRealTimers();
    vi.unstubAllGlobals();
  });
  const pass = (milliseconds: number): Promise<unknown> => vi.advanceTimersByTimeAsync(milliseconds);

  it("asks each server for what it has, at its own address", async () => {
    const asked = serve(() => bytes());
    const { loader, servers } = makeLoader();
    const list = [...leaves(), new Resource("orthoview/2/0/0/0/4/0-0123456789abcdef", "orthoview", 1000, null), new Resource("mesh/00000000000000aa", "mesh", 10, null)];
    loader.want(list.map(want), 1);
    await pass(100);
    const expected = list.map((one) => `${numberOf(one) === null ? HOME : BASES[numberOf(one)]}${one.key}`);
    expect(asked.filter((url) => !url.startsWith("knock")).sort()).toEqual(expected.sort());
    expect(asked.filter((url) => url.startsWith("knock")).sort()).toEqual(BASES.map((base) => `knock ${base}world.json`).sort());
    expect(new Set(list.map(({ state }) => state))).toEqual(new Set(["ready"]));
    expect(servers.requests).toBe(asked.length);
    expect(servers.bytes).toBe(list.length * 100);
  });

  it("asks the server it was opened at once more by another of its names, and none twice", () => {
    serve(() => bytes());
    const { servers, home } = makeServers({ level: 1, addresses: [HOME, "./", "../city/", "http://a.test/"] });
    expect(servers.all).toHaveLength(2);
    expect(servers.all[0]).toBe(home);
  });

  it("asks for several values at once where a server offers it, and only of that server", async () => {
    const asked = serve((url, init) => {
      const headers: Record<string, string> = url.host === "a.test" ? { "Farfield-Batch": "batch" } : {};
      if (init.method === "HEAD") return new Response(null, { headers });
      if (!url.pathname.endsWith("/batch")) return bytes();
      const count = url.searchParams.getAll("key").length;
      return new Response(new Uint8Array(4 * count));
    });
    const { loader } = makeLoader();
    const list = leaves();
    await pass(50);
    loader.want(list.map(want), 1);
    await pass(100);
    const own = list.filter((one) => numberOf(one) === 0).map(({ key }) => key);
    expect(asked.filter((url) => url.includes("/batch?")).flatMap((url) => new URL(url).searchParams.getAll("key"))).toEqual(own);
    expect(asked.filter((url) => url.startsWith("http://a.test/orthoview"))).toEqual([]);
    expect(new Set(list.map(({ state }) => state))).toEqual(new Set(["ready"]));
  });

  it("opens six connections to a server at most, and a server that is slow leaves the others alone", async () => {
    let open = 0;
    let most = 0;
    serve((url, init) => {
      if (init.method === "HEAD" || url.host !== "b.test") return bytes();
      most = Math.max(most, ++open);
      return new Promise(() => undefined);
    });
    const { loader } = makeLoader();
    const list = leaves();
    loader.want(list.map(want), 1);
    await pass(1000);
    expect(most).toBe(6);
    for (const number of [0, 2]) expect(statesAt(list, number)).toEqual(new Set(["ready"]));
    expect(statesAt(list, 1)).toEqual(new Set(["loading", "absent"]));
  });

  it("leaves a server that does not answer, and knocks at it after longer and longer pauses", async () => {
    let there = false;
    const asked = serve((url) => (url.host === "b.test" && !there ? refused() : bytes()));
    const { loader, servers, connections, bad } = makeLoader();
    const list = leaves();
    loader.want(list.map(want), 1);
    await pass(100);
    for (const number of [0, 2]) expect(statesAt(list, number)).toEqual(new Set(["ready"]));
    expect(servers.isAway(list.find((one) => numberOf(one) === 1)!.key)).toBe(false);
    await pass(60_000);
    const tries = asked.filter((url) => url.includes("b.test"));
    // At 0, 0.5, 1.5, 3.5, 7.5, 15.5, 30.5, 45.5 and, with a quarter of a second lost in each pause, not again at 60.5.
    expect(tries.length).toBeLessThanOrEqual(9);
    expect(new Set(tries)).toEqual(new Set(["knock http://b.test/city/world.json"]));
    expect(new Set(connections.map(({ at }) => at))).toEqual(new Set(["http://b.test/city/"]));
    for (const one of list) {
      expect(servers.isAway(one.key)).toBe(numberOf(one) === 1);
      expect(servers.lacking()(one)).toBe(numberOf(one) === 1);
    }
    there = true;
    await pass(16_000);
    expect(statesAt(list, 1)).toEqual(new Set(["ready"]));
    expect(connections.at(-1)).toMatchObject({ online: true });
    expect(servers.isAway(list[0]!.key)).toBe(false);
    expect(bad).toEqual([]);
  });

  it("does not run at a server that answers knocks and nothing else", async () => {
    const asked = serve((url, init) => (url.host === "b.test" && init.method !== "HEAD" ? new Response("", { status: 503 }) : bytes()));
    const { loader, bad } = makeLoader();
    loader.want(leaves().map(want), 1);
    await pass(60_000);
    expect(asked.filter((url) => url.startsWith("http://b.test")).length).toBeLessThanOrEqual(6 * 9);
    expect(bad).toEqual([]);
  });

  it("takes a server without a manifest, or that refuses HEAD, for one", async () => {
    serve((_, init) => (init.method === "HEAD" ? new Response("", { status: 405 }) : bytes()));
    const { loader } = makeLoader();
    const list = leaves();
    loader.want(list.map(want), 1);
    await pass(100);
    expect(new Set(list.map(({ state }) => state))).toEqual(new Set(["ready"]));
  });

  it("gives up a knock that is not answered", async () => {
    serve((url) => (url.host === "b.test" ? new Promise(() => undefined) : bytes()));
    const { servers } = makeServers();
    await pass(12_000);
    expect(servers.all.map(({ away }) => away)).toEqual([false, false, true, false]);
  });

  it("shows nothing in place of anything while no server answers at all", async () => {
    serve(refused);
    const { servers, home } = makeServers();
    home.failed("away");
    await pass(5000);
    expect(servers.all.every(({ away }) => away)).toBe(true);
    expect(leaves().some((one) => servers.isAway(one.key) || servers.lacking()(one))).toBe(false);
  });

  it("lets a GLB wait for its texture's server, and blames no other", async () => {
    vi.stubGlobal("createImageBitmap", () => Promise.resolve({ width: 1, height: 1 }));
    const hash = ["aa", "bb", "cc", "dd", "ee", "ff"].map((end) => `00000000000000${end}`).find((name) => serverOf(`texture/${name}`, RULE, GRID) === 1)!;
    const mesh = ["a1", "b1", "c1", "d1", "e1"].map((end) => new Resource(`mesh/00000000000000${end}`, "mesh", 10, null)).find((one) => numberOf(one) === 0)!;
    let there = false;
    const asked = serve((url) => (url.host === "b.test" && !there ? refused() : bytes()));
    const shelves: TextureShelf[] = [];
    const { loader, servers, bad } = makeLoader(async (_, found) => {
      await shelves[0]!.acquire(hash, false).finally(() => shelves[0]!.release(hash, false));
      return { size: found.length, install: () => found };
    });
    shelves.push(new TextureShelf(servers, undefined as never, () => 1));
    loader.want([want(mesh)], 1);
    await pass(10_000);
    expect(mesh).toMatchObject({ state: "absent", needs: `texture/${hash}` });
    expect(servers.lacking()(mesh)).toBe(true);
    expect(asked.filter((url) => url === `http://a.test/${mesh.key}`).length).toBe(1);
    there = true;
    await pass(16_000);
    expect(mesh).toMatchObject({ state: "ready", needs: null });
    expect(asked).toContain(`http://b.test/city/texture/${hash}`);
    expect(bad).toEqual([]);
  });

  it("ends its knocking when the world is closed", async () => {
    const asked = serve(refused);
    const { servers, connections } = makeServers();
    await pass(1000);
    servers.close();
    const { length } = asked;
    await pass(60_000);
    expect(asked.length).toBe(length);
    expect(connections.slice(-BASES.length).every(({ online }) => online)).toBe(true);
  });

  it("wants the parents of what is away", () => {
    const { root, cells } = makeWorld();
    hold(tilesOf(root));
    const near = view({ near: 0 });
    const plan = makePlan([root], DIRECTIONS, near);
    const away = cells.get("0/3/3/0")!;
    const lacks = (one: Resource): boolean => tilesOf(away).includes(one);
    const wanted = listWants([root], plan, MANIFEST, near, lacks);
    const parent = tilesOf(cells.get("1/1/1/0")!);
    expect(wanted.filter(({ resource }) => parent.includes(resource)).map(({ urgency }) => urgency)).toEqual([1, 1]);
    expect(listWants([root], plan, MANIFEST, near).filter(({ resource }) => parent.includes(resource))).toEqual([]);
  });
});

it("an error of the network names what could not be had", async () => {
  serve(refused);
  const { servers } = makeServers();
  const error: unknown = await servers.all[0]!.get("texture/00000000000000aa", new AbortController().signal).catch((thrown: unknown) => thrown);
  expect(error).toBeInstanceOf(FarfieldError);
  expect(error).toMatchObject({ tag: "network", where: "texture/00000000000000aa" });
  servers.close();
  vi.unstubAllGlobals();
});
