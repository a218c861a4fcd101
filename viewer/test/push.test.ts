import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Backoff } from "../src/core/backoff.js";
import { corrupt } from "../src/core/errors.js";
import { Loader, type Preparer } from "../src/core/loader.js";
import { PushClient } from "../src/core/push/client.js";
import { readMessage, readPiece, shared, type ViewMessage } from "../src/core/push/messages.js";
import { Resource } from "../src/core/resource.js";
import { Server, Servers } from "../src/core/servers.js";
import type { Found, Source } from "../src/core/source.js";
import { URGENCY, type Want } from "../src/core/wants.js";
import { MANIFEST } from "./worlds.js";

interface Said {
  readonly type: string;
  readonly [member: string]: unknown;
}

/** A server's side of sessions. */
class FakeSocket extends EventTarget {
  static made: FakeSocket[] = [];
  readyState = 0;
  binaryType = "";
  readonly said: Said[] = [];

  constructor(readonly address: URL) {
    super();
    FakeSocket.made.push(this);
  }

  send(text: string): void {
    this.said.push(JSON.parse(text) as Said);
  }

  close(): void {
    this.readyState = 3;
  }

  open(generation = 1): void {
    this.readyState = 1;
    this.dispatchEvent(new Event("open"));
    this.tell({ type: "welcome", version: 1, piece: 16384, generation });
  }

  tell(message: object | string | ArrayBuffer): void {
    const data = typeof message === "string" || message instanceof ArrayBuffer ? message : JSON.stringify(message);
    this.dispatchEvent(new MessageEvent("message", { data }));
  }

  piece(number: number, offset: number, bytes: number): void {
    const message = new ArrayBuffer(8 + bytes);
    new DataView(message).setUint32(0, number, true);
    new DataView(message).setUint32(4, offset, true);
    this.tell(message);
  }

  /** All of a value. */
  push(number: number, key: string, bytes = 100): void {
    this.tell({ type: "value", number, key, bytes });
    this.piece(number, 0, bytes);
  }

  lose(code = 1006): void {
    this.readyState = 3;
    this.dispatchEvent(Object.assign(new Event("close"), { reason: "", code }));
  }

  heard(type: string): Said[] {
    return this.said.filter((message) => message.type === type);
  }
}

const VIEW: ViewMessage = {
  eye: [0, 0, 1], forward: [0, 1, 0], fov: 50, size: [640, 480], velocity: [1, 0, 0], acceleration: [0, 0, 0], turning: 0.1,
  nearRadius: 4, bias: 0, leastGain: 10, farGeometry: false, dynamicImpostors: true,
};

const last = (): FakeSocket => FakeSocket.made.at(-1)!;
const keyOf = (n: number): string => `orthoview/0/${n}/0/0/4/0-00`;
const BOARD = "texture/fedcba9876543210";
/** What the values of these tests take once they are decoded: what is guessed of others of their kind. */
const DECODED = 1300;
const decoding: Preparer["prepare"] = (_, bytes) => Promise.resolve({ size: DECODED, install: () => bytes });
const want = (resource: Resource, urgency: number = URGENCY.seen): Want => ({ resource, urgency, distance: 0, level: 0 });
const later = (milliseconds: number): Promise<unknown> => vi.advanceTimersByTimeAsync(milliseconds);

interface World {
  readonly budget?: number;
  readonly prepare?: Preparer["prepare"];
  readonly stream?: URL | null;
  readonly known?: number;
}

/** A client and its loader over values 0, 1, 2 … of 100 bytes; `known`: how many of them the index tells of. */
function makeClient({ budget = 1e6, prepare, stream = new URL("ws://world.test/stream"), known = 50 }: World = {}) {
  const seen = { asked: [] as string[], bad: [] as string[], outdated: 0, generation: 1, away: false, known };
  const list = Array.from({ length: 50 }, (_, n) => new Resource(keyOf(n), "orthoview", 100, null));
  const board = new Resource(BOARD, "impostor", 100, null);
  const shelf = new Map<string, Uint8Array>();
  const answer = (keys: readonly string[]): Promise<Found[]> => {
    if (seen.away) return Promise.reject(new TypeError("away"));
    seen.asked.push(...keys);
    return Promise.resolve(keys.map(() => new Uint8Array(100)));
  };
  const source: Source = {
    base: "http://world.test/", bytes: 0, requests: 0, batchKeys: 10, events: null, stream, tag: null,
    manifest: () => Promise.reject(new Error("unused")),
    knock: () => (seen.away ? Promise.reject(new TypeError("away")) : Promise.resolve()),
    get: async (key) => (await answer([key]))[0] as Uint8Array,
    getMany: answer,
  };
  const preparer: Preparer = {
    prepare: prepare ?? ((_, bytes) => Promise.resolve({ size: bytes.length, install: () => bytes })),
    dispose: () => undefined,
  };
  const back = (): void => loader.pump();
  const server = new Server(source, new Backoff(() => performance.now(), () => undefined), new AbortController().signal, back, true);
  const loader: Loader = new Loader(new Servers(server, MANIFEST, () => server), preparer, budget, {
    bad: ({ key }) => void seen.bad.push(key),
    arrived: () => undefined,
  });
  const client = new PushClient({
    server, loader,
    find: (key) => [...list, board].slice(0, seen.known).find((resource) => resource.key === key) ?? null,
    images: {
      put: (key, value) => void shelf.set(key, value),
      keys: () => [...shelf.keys()],
      taken: (find) => [...shelf].flatMap(([key, value]) => {
        const resource = find(key);
        return resource && shelf.delete(key) ? [[resource, value] as [Resource, Uint8Array]] : [];
      }),
    },
    generation: () => seen.generation,
    token: () => "open sesame",
    outdated: () => void seen.outdated++,
  });
  loader.push = client;
  let number = 0;
  /** A plan that wants these. */
  const plan = (...wants: readonly Want[]): void => {
    loader.want(wants, ++number);
    client.settle(wants);
  };
  return { client, loader, list, board, shelf, seen, plan };
}

/** The same with a session that has begun. */
function inSession(world: World = {}) {
  const made = makeClient(world);
  made.client.see(VIEW);
  made.client.turn(true);
  last().open();
  return { ...made, socket: last() };
}

beforeEach(() => {
  vi.useFakeTimers();
  vi.stubGlobal("WebSocket", FakeSocket);
  FakeSocket.made = [];
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

describe("messages of a session", () => {
  it.each([
    "", "[]", "{", '{"type":5}', '{"type":"welcome"}', '{"type":"value","number":1,"key":"world.json","bytes":5}', "[".repeat(1e5),
    '{"type":"value","number":-1,"key":"mesh/00","bytes":5}', '{"type":"cancelled"}', '{"type":"missing","key":7}',
  ])("that cannot be are errors of the project's own: %.40s", (text) => {
    expect(() => readMessage(text)).toThrow(expect.objectContaining({ name: "FarfieldError", tag: "corrupt" }));
  });

  it("of a kind that is not known, and members that are not, are passed over", () => {
    expect(readMessage('{"type":"weather","rain":true}')).toBeNull();
    expect(readMessage('{"type":"toString"}')).toBeNull();
    expect(readMessage('{"type":"idle","more":1}')).toMatchObject({ type: "idle" });
  });

  it("a piece without any of its value is cut short", () => {
    expect(() => readPiece(new ArrayBuffer(8))).toThrow("cut short");
  });

  it("keys go in shares that a server takes", () => {
    const keys = Array.from({ length: 10_000 }, (_, n) => `mesh/${"0".repeat(n < 5000 ? 4 : 140)}${n}`);
    const shares = shared(keys);
    expect(shares.flat()).toEqual(keys);
    for (const share of shares) {
      expect(share.length).toBeLessThanOrEqual(4096);
      expect(JSON.stringify({ type: "add", keys: share }).length).toBeLessThanOrEqual(256 << 10);
    }
    expect(shares.length).toBeLessThan(7);
    expect(shared([])).toEqual([]);
  });
});

describe("a session", () => {
  it("begins with what is held, and says where the picture is seen from", async () => {
    const { client, list, plan } = makeClient();
    plan(want(list[0]!), want(list[1]!));
    await later(1);
    client.see(VIEW);
    client.turn(true);
    last().open();
    expect(String(last().address)).toBe("ws://world.test/stream");
    const hello = { type: "hello", version: 1, generation: 1, token: "open sesame", holds: [keyOf(0), keyOf(1)] };
    expect(last().said).toEqual([hello, { type: "view", ...VIEW }]);
    expect(client.on).toBe(true);
  });

  it("brings values in pieces, each acknowledged, and the loader asks for none", async () => {
    const { client, list, seen, plan, socket, loader } = inSession();
    plan(want(list[0]!), want(list[1]!));
    socket.tell({ type: "value", number: 1, key: keyOf(0), bytes: 20_000 });
    socket.piece(1, 0, 16_384);
    expect(socket.heard("ack")).toEqual([{ type: "ack", pieces: 1 }]);
    expect(list[0]!.state).toBe("loading");
    socket.piece(1, 16_384, 3616);
    socket.push(2, keyOf(1));
    await later(30);
    expect(socket.heard("ack").at(-1)).toEqual({ type: "ack", pieces: 3 });
    expect(list.slice(0, 2).map(({ state, size }) => [state, size])).toEqual([["ready", 20_000], ["ready", 100]]);
    expect(seen.asked).toEqual([]);
    expect(client.bytes).toBeGreaterThan(20_100);
    expect(loader.underWay).toBe(2);
  });

  it("gives images to who keeps them", async () => {
    const { list, shelf, plan, socket } = inSession();
    plan(want(list[0]!));
    socket.push(1, "texture/0123456789abcdef");
    socket.push(2, keyOf(0));
    await later(30);
    expect([...shelf.keys()]).toEqual(["texture/0123456789abcdef"]);
    expect(list[0]!.state).toBe("ready");
  });

  it("gives images that are drawn by themselves to the loader, also those that come before the index tells of them", async () => {
    const { list, board, shelf, loader, plan, socket } = inSession({ known: 51 });
    plan(want(list[0]!), want(board));
    socket.push(1, BOARD);
    await later(30);
    expect(board.state).toBe("ready");
    expect(shelf.size).toBe(0);
    loader.install(1e6);
    // Had in another way meanwhile: it is no different from other images.
    socket.push(2, BOARD);
    await later(30);
    expect([board.state, shelf.size]).toEqual(["held", 1]);
    plan(want(board));
    expect([board.state, shelf.size]).toEqual(["held", 0]);
    const other = inSession({ known: 50 });
    other.socket.push(1, BOARD);
    await later(30);
    expect([other.board.state, other.shelf.size]).toEqual(["absent", 1]);
    other.seen.known = 51;
    other.plan();
    expect([other.board.state, other.shelf.size]).toEqual(["fetched", 0]);
    expect(other.socket.heard("drop")).toEqual([]);
    other.client.renew();
    last().open();
    expect(last().heard("hello")).toMatchObject([{ holds: [BOARD] }]);
  });

  it("acknowledges at most fifty times a second: a server ends sessions that say more than a hundred things", async () => {
    const { socket } = inSession();
    for (let n = 1; n <= 1000; n++) {
      socket.push(n, keyOf(n % 50));
      await later(1);
    }
    await later(30);
    expect(socket.heard("ack").length).toBeLessThan(55);
    expect(socket.heard("ack").at(-1)).toEqual({ type: "ack", pieces: 1000 });
  });

  it("hears of views ten times a second, of one at rest once more, and of the same again before a minute has passed", async () => {
    const { client, socket } = inSession();
    for (let n = 0; n < 100; n++) {
      client.see({ ...VIEW, eye: [n, 0, 1] });
      await later(10);
    }
    expect(socket.heard("view").length).toBeLessThanOrEqual(11);
    const before = socket.heard("view").length;
    await later(2000);
    const resting = { type: "view", ...VIEW, eye: [99, 0, 1], velocity: [0, 0, 0], turning: 0 };
    expect(socket.heard("view").slice(before).at(-1)).toEqual(resting);
    const rested = socket.heard("view").length;
    await later(40_000);
    expect(socket.heard("view").length).toBe(rested + 2);
  });

  it("drops what was begun of a value that is cancelled, and takes it when it comes again", async () => {
    const { list, plan, socket } = inSession();
    plan(want(list[0]!));
    socket.tell({ type: "value", number: 1, key: keyOf(0), bytes: 40_000 });
    socket.piece(1, 0, 16_384);
    socket.tell({ type: "cancelled", number: 1 });
    expect(list[0]!.state).toBe("absent");
    socket.push(2, keyOf(0));
    await later(1);
    expect(list[0]!.state).toBe("ready");
  });

  it("a value that the server cannot read is asked for, and a damaged one too, once", async () => {
    const prepare: Preparer["prepare"] = ({ key }, bytes) =>
      bytes.length === 99 ? Promise.reject(corrupt("damaged", key)) : Promise.resolve({ size: 1, install: () => null });
    const { list, seen, plan, socket } = inSession({ prepare });
    plan(want(list[0]!), want(list[1]!));
    socket.tell({ type: "missing", key: keyOf(0) });
    socket.push(1, keyOf(1), 99);
    await later(1);
    expect(seen.asked).toEqual([keyOf(0), keyOf(1)]);
    expect(list.slice(0, 2).map(({ state }) => state)).toEqual(["ready", "ready"]);
    expect(seen.bad).toEqual([]);
  });

  it("keeps values of cells that the index does not tell of yet, until it does, or there are too many", async () => {
    const { list, seen, plan, socket } = inSession({ known: 0 });
    socket.push(1, keyOf(0));
    socket.push(2, keyOf(1), 1 << 20);
    for (let n = 2; n < 10; n++) socket.push(n + 1, keyOf(n), 1 << 20);
    seen.known = 50;
    plan(...list.slice(0, 10).map((resource) => want(resource)));
    await later(1);
    expect(list.slice(0, 10).map(({ state }) => state)).toEqual(["absent", "absent", ...new Array(8).fill("ready")]);
    expect(socket.heard("drop")).toEqual([{ type: "drop", keys: [keyOf(0), keyOf(1)] }]);
  });

  it("says what was let go when it is wanted again and there is room, not before", async () => {
    const { loader, list, plan, socket } = inSession({ budget: 12 * DECODED, prepare: decoding });
    plan(...list.slice(0, 10).map((resource) => want(resource)));
    for (let n = 0; n < 10; n++) socket.push(n + 1, keyOf(n));
    await later(1);
    loader.install(1e6);
    plan(...list.slice(10, 15).map((resource) => want(resource)));
    for (let n = 10; n < 15; n++) socket.push(n + 1, keyOf(n));
    await later(1);
    loader.install(1e6);
    expect(loader.cache.bytes).toBeLessThanOrEqual(12 * DECODED);
    expect(socket.heard("drop")).toEqual([]);
    plan(want(list[0]!), want(list[14]!));
    expect(socket.heard("drop")).toEqual([{ type: "drop", keys: [keyOf(0)] }]);
  });

  it("stays within the budget whatever is sent", async () => {
    const budget = 10 * DECODED;
    const { loader, list, plan, socket } = inSession({ budget, prepare: decoding });
    const wants = list.map((resource, n) => want(resource, n < 5 ? URGENCY.seen : URGENCY.unseen));
    plan(...wants);
    for (let n = 0; n < 50; n++) socket.push(n + 1, keyOf(n));
    await later(1);
    loader.install(1e6);
    plan(...wants);
    await later(1000);
    expect(list.slice(0, 5).every(({ held }) => held)).toBe(true);
    expect(list.some(({ state }) => state === "absent")).toBe(true);
    expect(loader.cache.bytes).toBeLessThanOrEqual(budget);
    expect(loader.stock.bytes).toBeLessThanOrEqual(loader.stock.budget);
  });

  it("is told of what the loader asks for when the server knows of nothing more, until it does", async () => {
    const { list, seen, plan, socket } = inSession();
    plan(want(list[0]!));
    expect(seen.asked).toEqual([]);
    socket.tell({ type: "idle" });
    expect(seen.asked).toEqual([keyOf(0)]);
    expect(socket.heard("add")).toEqual([{ type: "add", keys: [keyOf(0)] }]);
    await later(1);
    socket.push(1, keyOf(1));
    plan(want(list[0]!), want(list[2]!));
    await later(100);
    expect(seen.asked).toEqual([keyOf(0)]);
  });

  it("of another generation ends, and a newer manifest is looked for", () => {
    const { seen, client } = inSession();
    seen.generation = 2;
    client.renew();
    last().open(1);
    expect(client.on).toBe(false);
    expect(seen.outdated).toBe(1);
    client.renew();
    expect(last().readyState).toBe(3);
  });

  it("begins anew with a newer generation, and says what of it is held", async () => {
    const { client, list, plan, socket, seen } = inSession();
    plan(want(list[0]!));
    socket.push(1, keyOf(0));
    await later(1);
    seen.generation = 2;
    client.renew();
    expect(socket.readyState).toBe(3);
    last().open(2);
    expect(last().heard("hello")).toMatchObject([{ generation: 2, holds: [keyOf(0)] }]);
  });
});

describe("without a session", () => {
  it("none is tried where the server offers none, and none is kept that is not wanted", async () => {
    const { client, seen, list, plan } = makeClient({ stream: null });
    client.turn(true);
    plan(want(list[0]!));
    await later(1000);
    expect(FakeSocket.made).toEqual([]);
    expect(seen.asked).toEqual([keyOf(0)]);
    const other = inSession();
    other.client.turn(false);
    other.plan(want(other.list[0]!));
    expect(other.socket.readyState).toBe(3);
    expect(other.seen.asked).toEqual([keyOf(0)]);
  });

  it("the loader goes on at once, and the next session resumes with what is held by then", async () => {
    const { client, list, seen, plan, socket } = inSession();
    plan(want(list[0]!), want(list[1]!));
    socket.push(1, keyOf(0));
    socket.tell({ type: "value", number: 2, key: keyOf(1), bytes: 100 });
    socket.lose();
    expect(client.on).toBe(false);
    expect(seen.asked).toEqual([keyOf(1)]);
    await later(700);
    expect(FakeSocket.made).toHaveLength(2);
    last().open();
    expect(last().heard("hello")).toMatchObject([{ holds: [keyOf(0), keyOf(1)] }]);
    expect(client.on).toBe(true);
    expect(seen.bad).toEqual([]);
  });

  it("a server that is away is not tried for one, and one that is back is", async () => {
    const { seen, socket } = inSession();
    seen.away = true;
    socket.lose();
    await later(60_000);
    expect(FakeSocket.made).toHaveLength(1);
    seen.away = false;
    await later(16_000);
    expect(FakeSocket.made).toHaveLength(2);
  });

  it("three in a row that brought nothing are the last, unless it is only that none is free", async () => {
    const { client } = makeClient();
    client.turn(true);
    for (let n = 0; n < 10; n++) {
      last().lose(1013);
      await later(16_000);
    }
    expect(FakeSocket.made).toHaveLength(11);
    for (let n = 0; n < 10; n++) {
      last().lose();
      await later(16_000);
    }
    expect(FakeSocket.made).toHaveLength(13);
  });

  it.each([
    ["no message", "{"],
    ["a value that is too large", { type: "value", number: 1, key: keyOf(0), bytes: 1e12 }],
    ["a value within another", { type: "value", number: 2, key: keyOf(1), bytes: 10 }],
    ["a cancelled value that was not begun", { type: "cancelled", number: 7 }],
    ["a piece that is cut short", new ArrayBuffer(3)],
    ["a piece of another value", new Uint8Array([9, 0, 0, 0, 0, 0, 0, 0, 1]).buffer],
    ["a piece that does not follow", new Uint8Array([1, 0, 0, 0, 5, 0, 0, 0, 1]).buffer],
    ["a piece beyond the end", new Uint8Array(8 + 200).fill(0).fill(1, 0, 1).buffer],
  ])("goes on after %s", async (_, message) => {
    const { client, list, seen, plan, socket } = inSession();
    plan(want(list[0]!));
    if (!(typeof message === "object" && "bytes" in message && message.bytes === 1e12)) {
      socket.tell({ type: "value", number: 1, key: keyOf(0), bytes: 100 });
    }
    socket.tell(message);
    expect(client.on).toBe(false);
    expect(socket.readyState).toBe(3);
    await later(1);
    expect(seen.asked).toEqual([keyOf(0)]);
    expect(list[0]!.state).toBe("ready");
  });

  it.each([true, false])("asks for the rest of a picture after a few seconds when the eye moves no more (moves: %s)", async (moves) => {
    const { client, list, seen, plan, socket } = inSession();
    const wants = list.map((resource) => want(resource));
    plan(...wants);
    for (let n = 0; n < 45; n++) {
      if (moves) client.see({ ...VIEW, eye: [n, 0, 1] });
      socket.push(n + 1, keyOf(n));
      plan(...wants);
      await later(100);
    }
    expect(seen.asked.length > 0).toBe(!moves);
  });

  it("a session goes on that comes to what the picture needs after a while", async () => {
    const { client, list, plan, socket } = inSession();
    plan(want(list[0]!), want(list[1]!));
    await later(3500);
    const [late] = list.filter(({ state }) => state === "absent").concat(list.slice(2, 3));
    plan(want(late!));
    socket.tell({ type: "value", number: 1, key: late!.key, bytes: 20_000 });
    await later(2000);
    expect(client.on).toBe(true);
    socket.piece(1, 0, 16_384);
    await later(2000);
    socket.piece(1, 16_384, 3616);
    await later(1);
    expect(late!.state).toBe("ready");
  });

  it.each(["nothing", "what nobody wants", "a trickle"])("asks by itself when %s comes for a few seconds", async (what) => {
    const { list, seen, plan, socket } = inSession();
    const wants = [want(list[0]!), want(list[1]!)];
    plan(...wants);
    if (what === "a trickle") socket.tell({ type: "value", number: 1, key: keyOf(0), bytes: 5000 });
    for (let n = 0; n < 40; n++) {
      expect(seen.asked.length === 0 || n > 30).toBe(true);
      if (what === "what nobody wants") socket.push(n + 1, keyOf(10 + (n % 40)));
      if (what === "a trickle" && socket.readyState === 1) socket.piece(1, n, 1);
      await later(100);
    }
    expect(seen.asked.sort()).toEqual([keyOf(0), keyOf(1)]);
    expect(list.slice(0, 2).map(({ state }) => state)).toEqual(["ready", "ready"]);
  });
});
