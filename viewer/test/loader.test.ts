import { afterEach, describe, expect, it, vi } from "vitest";
import { Backoff, type Connection } from "../src/core/backoff.js";
import { corrupt } from "../src/core/errors.js";
import { Fetcher } from "../src/core/fetch.js";
import { Loader, type Preparer } from "../src/core/loader.js";
import { Resource } from "../src/core/resource.js";
import { Server, Servers } from "../src/core/servers.js";
import { URGENCY, type Want } from "../src/core/wants.js";
import { MANIFEST } from "./worlds.js";

type Answer = (key: string) => Response | Promise<Response>;

/** Answers fetch, one key a request or as a batch; returns the keys asked for. */
function serve(answer: Answer): string[] {
  const asked: string[] = [];
  vi.stubGlobal("fetch", (url: URL, init: RequestInit) => {
    const keys = url.pathname.endsWith("/batch") ? url.searchParams.getAll("key") : [url.pathname.slice(1)];
    asked.push(...keys);
    return new Promise<Response>((resolve, reject) => {
      init.signal?.addEventListener("abort", () => reject(new DOMException("stopped", "AbortError")));
      const whole = url.pathname.endsWith("/batch") ? batch(keys, answer) : answer(keys[0]!);
      Promise.resolve(whole).then(resolve, reject);
    });
  });
  return asked;
}

async function batch(keys: string[], answer: Answer): Promise<Response> {
  const parts: Uint8Array[] = [];
  for (const key of keys) {
    const found = await answer(key);
    const bytes = new Uint8Array(await found.arrayBuffer());
    const length = new Uint8Array(Uint32Array.of(found.ok ? bytes.length : 0xffffffff).buffer);
    parts.push(length, ...(found.ok ? [bytes] : []));
  }
  return new Response(new Blob(parts as BlobPart[]));
}

const want = (resource: Resource, urgency = 1): Want => ({ resource, urgency, distance: 0, level: 0 });
const resources = (count: number): Resource[] =>
  Array.from({ length: count }, (_, n) => new Resource(`orthoview/${n}`, "orthoview", 1000, null));

function makeLoader(budget = 1e6, prepare?: Preparer["prepare"]) {
  const seen = { bad: [] as string[], connections: [] as Connection[], disposed: [] as string[], unforeseen: 0 };
  const fetcher = new Fetcher("http://world.test/");
  const preparer: Preparer = {
    prepare: prepare ?? ((_, bytes) => Promise.resolve({ size: bytes.length, install: () => bytes })),
    dispose: ({ key }) => void seen.disposed.push(key),
  };
  const backoff = new Backoff(() => performance.now(), (connection) => seen.connections.push(connection));
  const server = new Server(fetcher, backoff, new AbortController().signal, () => loader.pump(), true);
  const loader: Loader = new Loader(new Servers(server, MANIFEST, () => server), preparer, budget, {
    bad: ({ key }) => void seen.bad.push(key),
    arrived: () => undefined,
    unforeseen: () => void seen.unforeseen++,
  });
  return { loader, fetcher, seen };
}

const bytes = (count = 100) => new Response(new Uint8Array(count));
const settle = (): Promise<void> => new Promise((resolve) => setTimeout(resolve, 20));

afterEach(() => vi.unstubAllGlobals());

describe("Loader", () => {
  it("fetches what is wanted once, most urgent first", async () => {
    const asked = serve(() => bytes());
    const { loader } = makeLoader();
    const list = resources(20);
    loader.want(list.map((resource) => want(resource)), 1);
    await settle();
    loader.install(1e9);
    loader.want(list.map((resource) => want(resource)), 2);
    await settle();
    expect(asked).toEqual(list.map(({ key }) => key));
    expect(list.every(({ held }) => held)).toBe(true);
    expect(loader.cache.bytes).toBe(2000);
  });

  it("asks for several values in one request where the server offers it", async () => {
    const asked = serve((key) =>
      key === "world.json" ? new Response("{}", { headers: { "Farfield-Batch": "batch" } }) : bytes(),
    );
    const { loader, fetcher, seen } = makeLoader();
    await fetcher.manifest(new AbortController().signal);
    const list = resources(8);
    loader.want(list.map((resource) => want(resource)), 1);
    await settle();
    expect(asked).toHaveLength(9);
    expect(fetcher.requests).toBe(2);
    expect(seen.bad).toEqual([]);
  });

  it.each([true, false])("takes a missing value for bad and goes on with the others (in a batch: %s)", async (batched) => {
    const headers: Record<string, string> = batched ? { "Farfield-Batch": "batch" } : {};
    serve((key) => {
      if (key === "world.json") return new Response("{}", { headers });
      return key === "orthoview/1" ? new Response("", { status: 404 }) : bytes();
    });
    const { loader, fetcher, seen } = makeLoader();
    await fetcher.manifest(new AbortController().signal);
    const list = resources(3);
    loader.want(list.map((resource) => want(resource)), 1);
    await settle();
    expect(seen.bad).toEqual(["orthoview/1"]);
    expect(list.map(({ state }) => state)).toEqual(["ready", "bad", "ready"]);
  });

  it("asks once more for a damaged value before it gives it up", async () => {
    const asked = serve(() => bytes());
    const { loader, seen } = makeLoader(1e6, ({ key }) => Promise.reject(corrupt("damaged", key)));
    loader.want([want(resources(1)[0]!)], 1);
    await settle();
    expect(asked).toEqual(["orthoview/0", "orthoview/0"]);
    expect(seen.bad).toEqual(["orthoview/0"]);
  });

  it("gives up requests that nobody wants any more", async () => {
    serve(() => new Promise(() => undefined));
    const { loader } = makeLoader();
    const [one] = resources(1);
    loader.want([want(one!)], 1);
    expect(one!.state).toBe("loading");
    loader.want([], 2);
    await settle();
    expect(one!.state).toBe("absent");
    expect(loader.underWay).toBe(0);
  });

  it("tries again after a while when the server is away", async () => {
    let away = true;
    const asked = serve(() => (away ? Promise.reject(new TypeError("failed to fetch")) : bytes()));
    const { loader, seen } = makeLoader();
    const [one] = resources(1);
    loader.want([want(one!)], 1);
    await settle();
    expect(asked).toHaveLength(1);
    expect(seen.connections).toMatchObject([{ online: false, failures: 1 }]);
    away = false;
    await new Promise((resolve) => setTimeout(resolve, 600));
    expect(one!.state).toBe("ready");
    expect(seen.connections.at(-1)).toMatchObject({ online: true });
    expect(seen.bad).toEqual([]);
  });

  it("stays within its budget, dropping what was used the longest ago", async () => {
    serve(() => bytes(1000));
    const { loader, seen } = makeLoader(5000);
    const list = resources(8);
    for (let n = 0; n < 8; n++) {
      loader.want([want(list[n]!)], n);
      await settle();
      loader.install(1e9);
      expect(loader.cache.bytes).toBeLessThanOrEqual(5000);
    }
    expect(seen.disposed).toEqual(["orthoview/0", "orthoview/1", "orthoview/2"]);
    expect(list.map(({ state }) => state === "held")).toEqual([false, false, false, true, true, true, true, true]);
  });

  it("lets what is wanted wait while it would not fit beside what is drawn", async () => {
    serve(() => bytes(1000));
    const { loader } = makeLoader(5500);
    loader.sizes.learn(Object.assign(new Resource("orthoview/seen", "orthoview", 1e9, null), { size: 1e9 }));
    const [drawn, list] = [resources(3), resources(9).slice(3)];
    loader.want(drawn.map((resource) => want(resource)), 1);
    await settle();
    loader.install(1e9);
    loader.want(list.map((resource) => want(resource)), 2, drawn);
    await settle();
    loader.install(1e9);
    expect(loader.cache.bytes).toBe(5000);
    loader.want(list.map((resource) => want(resource)), 3, drawn.slice(0, 1));
    await settle();
    expect(loader.cache.bytes).toBe(5000);
    expect(drawn.map(({ held }) => held)).toEqual([true, false, false]);
  });

  it("asks for one thing at a time when nothing fits", async () => {
    const asked = serve(() => bytes(1000));
    const { loader } = makeLoader(1500);
    const list = resources(4);
    loader.want(list.map((resource) => want(resource)), 1);
    for (let n = 1; n <= 4; n++) {
      await settle();
      expect(asked.length).toBe(n);
      loader.install(1e9);
    }
  });

  it("asks for all at once that may go beyond the budget", async () => {
    const asked = serve(() => bytes(1000));
    const { loader } = makeLoader(1500);
    const list = resources(6);
    loader.want(list.map((resource) => want(resource)), 1, [], true);
    await settle();
    expect(asked.length).toBe(6);
  });

  it("goes on after a second try that was given up", async () => {
    const asked = serve((key) => (key === "orthoview/0" && asked.length > 1 ? new Promise(() => undefined) : bytes(1000)));
    const { loader } = makeLoader(1500, (resource, found) =>
      resource.key === "orthoview/0"
        ? Promise.reject(corrupt("damaged", resource.key))
        : Promise.resolve({ size: found.length, install: () => found }),
    );
    const [damaged, other] = resources(2);
    loader.want([want(damaged!), want(other!)], 1);
    await settle();
    expect(asked).toEqual(["orthoview/0", "orthoview/0"]);
    loader.want([want(other!)], 2);
    await settle();
    expect(other!.state).toBe("ready");
  });

  it("uploads no more than a frame's share at a time", async () => {
    serve(() => bytes(1000));
    const { loader } = makeLoader();
    const list = resources(6);
    loader.want(list.map((resource) => want(resource)), 1);
    await settle();
    loader.install(2500);
    expect(list.filter(({ held }) => held)).toHaveLength(3);
  });

  describe("what is not needed now", () => {
    const AHEAD = URGENCY.ahead;
    const fetched = (list: Resource[]): number => list.filter(({ state }) => state === "fetched").length;

    it("is fetched into a stock of its own budget, decoded while the cache has room, and uploaded after what is needed", async () => {
      serve(() => bytes(1000));
      const { loader } = makeLoader(12_000);
      const list = resources(20);
      loader.sizes.learn(Object.assign(new Resource("orthoview/seen", "orthoview", 1e9, null), { size: 1e9 }));
      loader.want(list.map((resource) => want(resource, AHEAD)), 1);
      await settle();
      // 70 % of the cache, and as many more as a twelfth of it holds undecoded.
      expect(loader.cache.bytes).toBe(8000);
      expect(fetched(list)).toBe(1);
      expect(loader.stock.bytes).toBeLessThanOrEqual(loader.stock.budget);
      loader.install(1e9);
      expect(loader.uploaded).toBeGreaterThan(0);
      expect(loader.uploaded).toBeLessThanOrEqual(12_000 * 0.6 + 1000);
    });

    it("is decoded at once when the picture comes to need it, and not asked for again", async () => {
      const asked = serve(() => bytes(1000));
      const { loader } = makeLoader(12_000, (resource, found) => Promise.resolve({ size: resource.key === "orthoview/0" ? 9000 : found.length, install: () => found }));
      const [large, small] = resources(2);
      loader.want([want(large!)], 1);
      await settle();
      loader.install(1e9);
      loader.want([want(large!), want(small!, AHEAD)], 2);
      await settle();
      expect(small!.state).toBe("fetched");
      loader.want([want(large!), want(small!)], 3);
      await settle();
      expect(small!.state).toBe("ready");
      expect(asked).toEqual(["orthoview/0", "orthoview/1"]);
    });

    it("never drives out what the picture uses", async () => {
      serve(() => bytes(1000));
      const { loader, seen } = makeLoader(10_000);
      loader.sizes.learn(Object.assign(new Resource("orthoview/seen", "orthoview", 1e9, null), { size: 1e9 }));
      const list = resources(40);
      const needed = list.slice(0, 6);
      for (let number = 1; number <= 5; number++) {
        loader.want([...needed.map((resource) => want(resource)), ...list.slice(6).map((resource) => want(resource, AHEAD))], number);
        await settle();
        loader.install(1e9);
      }
      expect(needed.every(({ held }) => held)).toBe(true);
      expect(seen.disposed).toEqual([]);
      expect(loader.cache.bytes).toBeLessThanOrEqual(10_000);
    });

    it("has two requests at most, so that the others stay free for what is needed", async () => {
      const asked = serve(() => new Promise(() => undefined));
      const { loader } = makeLoader(1e9);
      const list = resources(40);
      loader.want(list.map((resource) => want(resource, AHEAD)), 1);
      expect(asked).toHaveLength(2);
      loader.want([want(list[39]!), ...list.slice(0, 39).map((resource) => want(resource, AHEAD))], 2);
      expect(asked).toEqual(["orthoview/0", "orthoview/1", "orthoview/39"]);
    });

    it.each(["mesh", "impostor"] as const)("of a mesh that no plan has asked for is told, and is decoded once one does (%s)", async (kind) => {
      const { loader, seen } = makeLoader();
      const mesh = new Resource("mesh/0123456789abcdef", kind, 1000, null);
      const [tile] = resources(1);
      for (const resource of [mesh, tile!]) {
        loader.awaits(resource, 1000);
        loader.deliver(resource, new Uint8Array(1000));
      }
      expect([mesh.state, tile!.state, seen.unforeseen]).toEqual(["fetched", "fetched", 1]);
      loader.want([want(mesh)], 1);
      await settle();
      loader.install(1e9);
      // It stays as long as it is drawn, whatever else is wanted.
      loader.cache.budget = 500;
      loader.want([], 2, [mesh]);
      expect(mesh.held).toBe(true);
      loader.want([], 3);
      expect(mesh.state).toBe("absent");
    });

    it("is dropped from the stock when nobody wants it and the room is needed", async () => {
      serve(() => bytes(1000));
      const { loader } = makeLoader(1e6);
      loader.cache.budget = 0;
      loader.stock.budget = 3500;
      const list = resources(6);
      loader.want(list.slice(0, 3).map((resource) => want(resource, AHEAD)), 1);
      await settle();
      expect(fetched(list)).toBe(3);
      loader.stock.budget = 1500;
      loader.want(list.slice(2).map((resource) => want(resource, AHEAD)), 2);
      await settle();
      expect(list.map(({ state }) => state)).toEqual(["absent", "absent", "fetched", "absent", "absent", "absent"]);
    });
  });

  it("asks for two large values at once, and lets small ones pass them", () => {
    const asked = serve(() => new Promise(() => undefined));
    const { loader } = makeLoader(1e9);
    const large = Array.from({ length: 4 }, (_, n) => new Resource(`geometry/${n}`, "geometry", 5e6, null));
    loader.want([...large, ...resources(2)].map((resource) => want(resource)), 1);
    expect(asked).toEqual(["geometry/0", "geometry/1", "orthoview/0", "orthoview/1"]);
  });
});
