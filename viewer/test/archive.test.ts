import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { ArchiveFetcher } from "../src/core/archive/fetcher.js";
import { groupSpans } from "../src/core/archive/groups.js";
import { decodeDirectory, decodeHeader } from "../src/core/archive/layout.js";
import { compareRanks, rankOf } from "../src/core/archive/order.js";
import { crc32 } from "../src/core/crc32.js";
import { FarfieldError } from "../src/core/errors.js";
import { sourceOf } from "../src/three/opening.js";
import { readJson, readVector } from "./vectors.js";

const ARCHIVE = readVector("archive/cells.farfield");
/** Keys in the order of the archive, and the CRC-32 of each value. */
const EXPECTED = readJson<Record<string, number>>("archive/cells.json");
const KEYS = Object.keys(EXPECTED);
const HEAD_BYTES = 64 << 10;

interface Damaged {
  readonly total: number;
  readonly directories: readonly { readonly what: string; readonly block: string }[];
  readonly headers: readonly { readonly what: string; readonly bytes: string }[];
}

const DAMAGED = readJson<Damaged>("archive/damaged.json");
const bytesOf = (hex: string): Uint8Array => new Uint8Array(Buffer.from(hex, "hex"));

interface Asked {
  readonly start: number;
  readonly end: number;
  readonly cache: string | undefined;
}

/** Answers byte ranges of `file`; `change` sees each answer's bytes first. Returns the ranges asked for. */
function serve(file: Uint8Array, change: (bytes: Uint8Array, asked: Asked) => Response | null = () => null): Asked[] {
  const list: Asked[] = [];
  vi.stubGlobal("fetch", (_: URL, init: RequestInit) => {
    const [, first, last] = /^bytes=(\d+)-(\d+)$/.exec(new Headers(init.headers).get("Range")!)!;
    const asked = { start: Number(first), end: Math.min(Number(last) + 1, file.length), cache: init.cache };
    list.push(asked);
    const bytes = file.slice(asked.start, asked.end);
    const headers = { "Content-Range": `bytes ${first}-${asked.end - 1}/${file.length}` };
    return Promise.resolve(change(bytes, asked) ?? new Response(bytes as BlobPart as Blob, { status: 206, headers }));
  });
  return list;
}


const { signal } = new AbortController();
const open = async (): Promise<ArchiveFetcher> => {
  const fetcher = new ArchiveFetcher("http://world.test/cells.farfield");
  await fetcher.manifest(signal);
  return fetcher;
};

afterEach(() => vi.unstubAllGlobals());

describe("the layout of an archive", () => {
  it("orders keys as Python does", () => {
    const shuffled = [...KEYS].sort();
    expect(shuffled.sort((a, b) => compareRanks(rankOf(a), rankOf(b)))).toEqual(KEYS);
  });

  it.each(DAMAGED.directories)("refuses a directory: $what", ({ block }) => {
    expect(() => decodeDirectory(bytesOf(block), DAMAGED.total, "here")).toThrow(expect.objectContaining({ tag: "corrupt" }));
  });

  it.each(DAMAGED.headers)("refuses a header: $what", ({ bytes }) => {
    expect(() => decodeHeader(bytesOf(bytes), "here")).toThrow(expect.objectContaining({ tag: "corrupt" }));
  });

  it("tells what is no archive from what a newer farfield wrote", () => {
    const newer = ARCHIVE.slice(0, 44);
    newer[4] = 2;
    expect(() => decodeHeader(newer, "here")).toThrow(expect.objectContaining({ tag: "version" }));
    for (const bytes of [new Uint8Array(), new TextEncoder().encode("<!doctype html>".repeat(5))]) {
      expect(() => decodeHeader(bytes, "here")).toThrow(expect.objectContaining({ tag: "not-a-world" }));
    }
  });

  it("gathers neighbours into one request, but not for ever", () => {
    const span = (offset: number, length: number) => ({ offset, length, checksum: 0 });
    const [a, b, far, large] = [span(0, 100), span(200, 100), span(1 << 20, 10), span((1 << 20) + 10, 1 << 20)];
    expect(groupSpans([far, b, large, a, a])).toEqual([[a, b], [far], [large]]);
    expect(groupSpans([])).toEqual([]);
  });
});

describe("ArchiveFetcher", () => {
  it("reads every value, alone or with others", async () => {
    serve(ARCHIVE);
    const fetcher = await open();
    for (const key of KEYS) expect(crc32(await fetcher.get(key, signal))).toBe(EXPECTED[key]);
    const found = await fetcher.getMany([...KEYS, "mesh/none", "a"], signal);
    expect(found.map((value) => value && crc32(value as Uint8Array))).toEqual([...Object.values(EXPECTED), null, null]);
    await expect(fetcher.get("mesh/none", signal)).rejects.toMatchObject({ tag: "missing", where: "mesh/none" });
  });

  it("opens with one request, past what a cache may hold", async () => {
    const asked = serve(ARCHIVE);
    const fetcher = new ArchiveFetcher("http://world.test/cells.farfield");
    expect(JSON.parse(await fetcher.manifest(signal))).toEqual({ format: "farfield-world" });
    expect(asked).toEqual([{ start: 0, end: ARCHIVE.length, cache: "no-cache" }]);
    expect(ARCHIVE.length).toBeLessThan(HEAD_BYTES);
    expect([fetcher.requests, fetcher.bytes]).toEqual([1, ARCHIVE.length]);
  });

  describe("of an archive larger than the first answer", () => {
    /** Answers no more than 20,000 bytes at first, so that directories and most values have to be asked for. */
    const short = (bytes: Uint8Array, { start }: Asked): Response | null =>
      start > 0 ? null : new Response(bytes.slice(0, 20_000) as BlobPart as Blob, { status: 206 });
    let asked: Asked[];
    beforeEach(() => (asked = serve(ARCHIVE, short)));

    it("reads each directory once, and neighbours together", async () => {
      const fetcher = await open();
      const cell = KEYS.filter((key) => key.startsWith("orthoview/0/3/"));
      expect(cell.length).toBeGreaterThan(8);
      const first = await fetcher.getMany(cell, signal);
      const directories = asked.length;
      expect(first.every((value) => value instanceof Uint8Array)).toBe(true);
      await fetcher.getMany(cell, signal);
      expect(asked.length - directories).toBeLessThan(4);
      expect(new Set(asked.slice(0, directories).map(({ start }) => start)).size).toBe(directories);
    });

    it("takes a directory that could not be read for no reason to give up", async () => {
      const fetcher = await open();
      const working = globalThis.fetch;
      vi.stubGlobal("fetch", () => Promise.reject(new TypeError("failed to fetch")));
      await expect(fetcher.getMany([KEYS.at(-1)!], signal)).rejects.toMatchObject({ tag: "network" });
      vi.stubGlobal("fetch", working);
      expect(await fetcher.getMany([KEYS.at(-1)!], signal)).toHaveLength(1);
    });
  });

  it("asks once more, past all caches, for what is damaged, and gives up that value alone", async () => {
    const manifest = "{\"format\": \"farfield-world\"}";
    const place = Buffer.from(ARCHIVE).indexOf("far", (16 << 10) + manifest.length);
    const bad = ARCHIVE.slice();
    bad[place]! ^= 1;
    const asked = serve(bad);
    const fetcher = await open();
    const key = "orthoview/0/999999999/-999999999/0/1/0-00000000000000cc";
    const [damaged, other] = await fetcher.getMany([key, KEYS[3]!], signal);
    expect(damaged).toBeInstanceOf(FarfieldError);
    expect(damaged).toMatchObject({ tag: "corrupt" });
    expect(crc32(other as Uint8Array)).toBe(EXPECTED[KEYS[3]!]);
    expect(asked.at(-1)).toEqual({ start: place, end: place + 3, cache: "reload" });
    await expect(fetcher.get(key, signal)).rejects.toMatchObject({ tag: "corrupt" });
  });

  it("gives what was stored or an error, whatever byte is altered", async () => {
    for (let place = 0; place < ARCHIVE.length; place += place < 120 ? 1 : 487) {
      const bad = ARCHIVE.slice();
      bad[place]! ^= 1 + (place % 255);
      serve(bad);
      const fetcher = new ArchiveFetcher("http://world.test/cells.farfield");
      const found = await fetcher.getMany(KEYS, signal).catch((error: unknown) => [error]);
      found.forEach((value, n) => {
        if (value instanceof Uint8Array) expect(crc32(value)).toBe(EXPECTED[KEYS[n]!]);
        else expect((value as FarfieldError).tag).toMatch(/^(corrupt|version|not-a-world)$/);
      });
    }
  });

  it("says so when the server ignores ranges, without taking the whole file", async () => {
    serve(ARCHIVE, (bytes) => {
      const answer = new Response(bytes as BlobPart as Blob, { status: 200 });
      answer.arrayBuffer = () => Promise.reject(new Error("the whole file was read"));
      return answer;
    });
    await expect(open()).rejects.toMatchObject({ tag: "no-ranges", what: "The server does not support byte ranges." });
  });

  it.each([
    ["cut short", "corrupt", ARCHIVE.subarray(0, ARCHIVE.length - 1)],
    ["something else", "not-a-world", new TextEncoder().encode("<!doctype html>")],
  ])("refuses a file that is %s", async (_, tag, file) => {
    serve(file);
    await expect(open()).rejects.toMatchObject({ tag, where: "http://world.test/cells.farfield" });
  });

  it("is what reads an address that ends in .farfield", () => {
    expect(sourceOf("http://a.test/city.farfield?x=1#y")).toBeInstanceOf(ArchiveFetcher);
    expect(sourceOf("http://a.test/city.farfield?x=1#y").base).toBe("http://a.test/city.farfield?x=1/");
    for (const url of ["http://a.test/city", "http://a.test/city/", "http://a.test/city/world.json"]) {
      expect(sourceOf(url)).toMatchObject({ base: "http://a.test/city/" });
    }
  });
});
