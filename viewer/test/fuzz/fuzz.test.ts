/**
 * Whatever bytes hold: every decoder reads them or throws the project's own error, in time and in bounded memory. A seed and a number
 * make a case; the Python twin is tests/fuzz.
 */
import { readFileSync } from "node:fs";
import { runInThisContext } from "node:vm";
import { constants, deflateRawSync } from "node:zlib";
import { unzipSync } from "fflate";
import { Texture } from "three";
import { beforeAll, describe, expect, it, vi } from "vitest";
import { decodeAttributeIndex, decodeAttributeTable } from "../../src/core/attributes.js";
import { decodeBlockMap } from "../../src/core/blockmap/decode.js";
import { decodeBlockMapObjects } from "../../src/core/blockmap/objects.js";
import { Cell, SharedMeshes } from "../../src/core/cell.js";
import { checkGlb, glbOf } from "../../src/core/decode/glb.js";
import { FarfieldError } from "../../src/core/errors.js";
import { unpack } from "../../src/core/fetch.js";
import { parseKey } from "../../src/core/grid.js";
import { decodeIndexTile, type CellEntry } from "../../src/core/indextile.js";
import { inflate } from "../../src/core/inflate.js";
import { decodeManifest } from "../../src/core/manifest.js";
import { decodeTile, WORDS } from "../../src/core/orthoview/decode.js";
import { PLANE } from "../../src/core/orthoview/header.js";
import { decodeObjectTile } from "../../src/core/orthoview/objects.js";
import { readMessage, readPiece } from "../../src/core/push/messages.js";
import { parseNearModel } from "../../src/three/near/parse.js";
import type { TextureShelf } from "../../src/three/near/textures.js";
import { listVectors, readJson, readVector } from "../vectors.js";
import { joined, mutated, mutatedJson, Random } from "./mutate.js";
import {
  BARE, BARE_JSON, blockMapStream, deflated, GLB_BODY, GLB_JSON, INDEX_TEXT, OBJECTS_STREAM, PACKED, PACKED_STREAM, plane, SEALED,
  SEALED_OBJECTS, tables, type Shell,
} from "./shells.js";

const SAMPLE = 250;
const SECONDS = 2;
const ROOM = 16 << 20;
/** The `inflate` of a long stream takes this besides, for a moment. */
const INFLATE_ROOM = 128 << 20;

interface Decoder {
  readonly name: string;
  decode(bytes: Uint8Array): unknown;
  readonly corpus: readonly Uint8Array[];
  readonly shells: readonly Shell[];
  /** Bytes that it may take at most. */
  bound(bytes: Uint8Array): number;
}

const GOLDEN = unzipSync(readFileSync(new URL("../../../tests/fixtures/world-v1.zip", import.meta.url)));
const below = (folder: string): Uint8Array[] => Object.keys(GOLDEN).filter((name) => name.startsWith(folder)).sort().map((name) => GOLDEN[name]!);
const vectors = (folder: string): Uint8Array[] => listVectors(folder, ".ffov").map((name) => readVector(`${folder}/${name}`));
const PACKED_NEAR = ["near", "near/version-1"].flatMap((folder) => listVectors(folder, ".bin").map((name) => readVector(`${folder}/${name}`)));
const NEAR = PACKED_NEAR.map((value) => glbOf(value, "near"));
const BLOCKMAPS = listVectors("blockmaps", ".json").filter((name) => name !== "corrupt.json")
  .map((name) => readJson<{ readonly blockmap: string; readonly object_ids: string }>(`blockmaps/${name}`));
const fromBase64 = (content: string): Uint8Array => new Uint8Array(Buffer.from(content, "base64"));
const text = (bytes: Uint8Array): string => new TextDecoder().decode(bytes);
const SERVERS = { rule: "cell-crc32", level: 1, addresses: ["https://a.example.org/city/", "./", "../b/"] };
const SPLIT = new TextEncoder().encode(JSON.stringify({ ...(JSON.parse(text(GOLDEN["world.json"]!)) as object), servers: SERVERS }));
const manifest = decodeManifest(text(GOLDEN["world.json"]!), "");
const u32At = (bytes: Uint8Array, at: number): number => (bytes.length < at + 4 ? 0 : new DataView(bytes.buffer, bytes.byteOffset).getUint32(at, true));

const SAID = [
  { type: "welcome", version: 1, generation: 4, piece: 16384 },
  { type: "value", number: 3, key: "orthoview/1/0/-2/0/13/0-0123456789abcdef", bytes: 40_000 },
  { type: "cancelled", number: 3 },
  { type: "missing", key: "mesh/0123456789abcdef" },
];

/** Node has no decoder of WebP. */
const grey = (_: Uint8Array, width: number, height: number): Promise<Uint8ClampedArray> =>
  Promise.resolve(new Uint8ClampedArray(width * height * 4).fill(99));
const shelf = { isTaken: () => false, acquire: () => Promise.resolve(new Texture({ width: 1, height: 1 })), release: () => undefined } as unknown as TextureShelf;

async function orthoview(bytes: Uint8Array): Promise<void> {
  const { width, height, count, pixels } = await decodeTile(bytes, "tile", grey);
  expect(pixels.length).toBe(count * WORDS);
  for (let k = 0; k < pixels.length; k += WORDS) {
    const [column, row] = [pixels[k]! & 4095, (pixels[k]! >>> 12) & 4095];
    if (column >= width || row >= height || pixels[k + 2]! >>> 21 !== 0) throw new Error("a pixel outside the tile");
  }
}

/** A BlockMap whose places, which shaders look up, lie in its image. */
async function blockMap(bytes: Uint8Array): Promise<void> {
  const { n, m, across, sides, colors } = await decodeBlockMap(bytes, "blockmap", grey, [8, 4]);
  expect(colors.length).toBe(4 * n * (n + m));
  for (let at = 0; at < sides.length; at += 4) {
    if (sides[at]! + across > m || sides[at + 1]! + sides[at + 2]! > n || sides[at + 3]! > 63) throw new Error("a wall outside the image");
  }
}

/** Reads an index tile into cells, as the viewer does. */
function index(bytes: Uint8Array): void {
  const entries = new Map<string, CellEntry>(decodeIndexTile(bytes, "index").map((entry) => [entry.key, entry]));
  const root = new Cell(parseKey([...entries.keys()][0]!), null, manifest.grid);
  root.read(entries, new SharedMeshes(), "index");
}

/** An index tile that tells of instances in its leaves, of which it has some. */
function placing(): Uint8Array {
  const [value] = below("index");
  const { root, cells } = JSON.parse(text(INDEX_TEXT.open(value!)!)) as { root: string; cells: CellEntry[] };
  const level = { hash: "0123456789abcdef", bytes: 900, triangles: 2000, textures: [["fedcba9876543210", 99]] };
  const levels = [level, { ...level, textures: [], errors: [9, 30, 80] }];
  const transform = [0, -1, 0, 4.5, 1, 0, 0, 2.25, 0, 0, 1, 0.125];
  const images = [["0123456789abcde0", 940], ["0123456789abcde1", 960]];
  const impostors = [{ rows: 96, images, errors: [20, 60, 110] }, { rows: 24, images: images.slice(1) }];
  const instances = [{ bounds: [[-1, -1, 0], [1, 1, 2]], levels, objects: [7, 9], transforms: [transform, transform], impostors }];
  const placed = cells.map((cell) => (cell.geometry ? { ...cell, instances } : cell));
  expect(placed).not.toEqual(cells);
  return INDEX_TEXT.close(value!, new TextEncoder().encode(JSON.stringify({ root, cells: placed })));
}

/** Bytes deflated behind their length. */
const stream = (content: Uint8Array): Uint8Array => joined(new Uint8Array(Uint32Array.of(content.length).buffer), deflated(content));
const STREAM: Shell = { name: "stream", open: (value) => inflate(value.subarray(4), u32At(value, 0), ""), close: (_, part) => stream(part) };

const NOISE = readVector("tiles/noise.ffov");
const ATTRIBUTES = new TextEncoder().encode(JSON.stringify({ columns: { height: [9, 12.5, null], name: ["a", "b", null] } }));
const ATTRIBUTE_INDEX = new TextEncoder().encode(JSON.stringify({ objects: 40, parts: [[1, 3, "0123456789abcdef"], [4097, 30, "fedcba9876543210"]] }));

const DECODERS: readonly Decoder[] = [
  {
    name: "orthoview",
    decode: orthoview,
    corpus: [...["tiles", "tiles/deflated"].flatMap(vectors), ...below("orthoview").slice(0, 8)],
    shells: [BARE, SEALED, SEALED, ...Object.values(PLANE).flatMap((kind) => [plane(kind), tables(kind)])],
    bound: (bytes) => 96 * Math.min(4096, u32At(bytes, 20) & 0xffff) * Math.min(4096, u32At(bytes, 20) >>> 16) + INFLATE_ROOM,
  },
  {
    name: "object ids",
    decode: (bytes) => decodeObjectTile(NOISE, bytes, "ids"),
    corpus: ["tiles", "tiles/deflated"].map((folder) => readVector(`${folder}/noise.ffid`)),
    shells: [BARE, SEALED, plane(PLANE.objects), plane(PLANE.objects), tables(PLANE.objects)],
    bound: () => 32 * 11 * 13 + INFLATE_ROOM,
  },
  { name: "attributes", decode: (bytes) => decodeAttributeTable(bytes, "table"), corpus: [ATTRIBUTES], shells: [BARE, BARE_JSON], bound: (bytes) => 64 * bytes.length },
  { name: "index of attributes", decode: (bytes) => decodeAttributeIndex(bytes, "index"), corpus: [ATTRIBUTE_INDEX], shells: [BARE, BARE_JSON], bound: (bytes) => 64 * bytes.length },
  {
    name: "blockmap",
    decode: blockMap,
    corpus: BLOCKMAPS.map(({ blockmap }) => fromBase64(blockmap)),
    shells: [BARE, SEALED, SEALED, blockMapStream(0), blockMapStream(0), blockMapStream(1), blockMapStream(2)],
    bound: () => 64 * 64 * 320 + INFLATE_ROOM,
  },
  {
    name: "blockmap objects",
    decode: (bytes) => decodeBlockMapObjects(bytes, "objects"),
    corpus: BLOCKMAPS.map(({ object_ids: ids }) => fromBase64(ids)),
    shells: [BARE, SEALED_OBJECTS, SEALED_OBJECTS, OBJECTS_STREAM],
    bound: () => 16 * 64 * 64 + INFLATE_ROOM,
  },
  { name: "index", decode: index, corpus: [...below("index"), placing()], shells: [BARE, INDEX_TEXT, INDEX_TEXT], bound: (bytes) => 64 * Math.min(64 << 20, u32At(bytes, 8)) + INFLATE_ROOM },
  { name: "manifest", decode: (bytes) => decodeManifest(text(bytes), "world.json"), corpus: [GOLDEN["world.json"]!, SPLIT], shells: [BARE_JSON], bound: (bytes) => 64 * bytes.length },
  {
    name: "inflate",
    decode: (bytes) => inflate(bytes.subarray(4), u32At(bytes, 0) % (1 << 24), "stream"),
    corpus: [stream(new Random(1).bytes(3000)), stream(new Uint8Array(70_000)), stream(new Random(2).bytes(100_000).map((byte) => byte >> 4))],
    shells: [BARE, BARE, STREAM],
    bound: (bytes) => (u32At(bytes, 0) % (1 << 24)) + INFLATE_ROOM,
  },
  {
    name: "batch",
    decode: (bytes) => unpack(bytes, ["a", "b", "c"], "batch"),
    corpus: [joined(Uint8Array.of(3, 0, 0, 0, 1, 2, 3, 255, 255, 255, 255, 0, 0, 0, 0))],
    shells: [BARE],
    bound: () => 0,
  },
  {
    name: "session message",
    decode: (bytes) => readMessage(text(bytes)),
    corpus: SAID.map((message) => new TextEncoder().encode(JSON.stringify(message))),
    shells: [BARE, BARE_JSON],
    bound: (bytes) => 64 * bytes.length,
  },
  { name: "session piece", decode: (bytes) => readPiece(bytes.slice().buffer), corpus: [new Random(3).bytes(40)], shells: [BARE], bound: (bytes) => 2 * bytes.length },
  {
    name: "packed glb",
    decode: (bytes) => checkGlb(glbOf(bytes, "glb"), "glb"),
    corpus: PACKED_NEAR,
    shells: [BARE, PACKED, PACKED_STREAM],
    bound: (bytes) => 64 * Math.max(bytes.length, Math.min(1 << 30, u32At(bytes, 8))) + INFLATE_ROOM,
  },
  { name: "checkGlb", decode: (bytes) => checkGlb(bytes, "glb"), corpus: [...below("geometry"), ...below("mesh"), ...NEAR], shells: [BARE, GLB_JSON, GLB_JSON, GLB_BODY], bound: (bytes) => 64 * bytes.length },
  { name: "near model", decode: (bytes) => parseNearModel(bytes, "glb", shelf), corpus: [...below("geometry"), ...below("mesh")], shells: [GLB_JSON, GLB_JSON, GLB_BODY], bound: (bytes) => 64 * bytes.length },
];

function makeCase({ corpus, shells }: Decoder, random: Random): Uint8Array {
  const [value, other] = [random.choice(corpus), random.choice(corpus)];
  const shell = random.choice(shells);
  const part = shell.open(value);
  if (part === null) return mutated(value, other, random);
  if (shell.json && random.next() < 0.8) return shell.close(value, new TextEncoder().encode(mutatedJson(text(part), random)));
  return shell.close(value, mutated(part, shell.open(other) ?? other, random));
}

/** What runs is interrupted when the time is up; what goes on after an `await` is only timed. */
function interruptible(run: () => unknown): unknown {
  const holder = globalThis as { runCase?: () => unknown };
  holder.runCase = run;
  return runInThisContext("runCase()", { timeout: SECONDS * 1000 });
}

const held = (): number => {
  const { arrayBuffers, heapUsed } = process.memoryUsage();
  return arrayBuffers + heapUsed;
};

/** Whether the bytes were read (or else refused). Throws what a decoder must not throw. */
async function judge(decoder: Decoder, bytes: Uint8Array, name: string): Promise<boolean> {
  const [before, began] = [held(), performance.now()];
  let read = true;
  try {
    await interruptible(() => decoder.decode(bytes));
  } catch (error) {
    if (!(error instanceof FarfieldError)) throw new Error(`${name}: ${String(error)}`, { cause: error });
    read = false;
  }
  expect(performance.now() - began, `${name}: milliseconds`).toBeLessThan(SECONDS * 1000);
  expect(held() - before, `${name}: bytes`).toBeLessThan(decoder.bound(bytes) + ROOM);
  return read;
}

describe.each(DECODERS)("$name", (decoder) => {
  // What three says of damaged materials.
  beforeAll(() => void vi.spyOn(console, "warn").mockReturnValue());

  it("reads valid values", async () => {
    for (const value of decoder.corpus) {
      for (const shell of decoder.shells) {
        const part = shell.open(value);
        expect(await judge(decoder, part ? shell.close(value, part) : value, shell.name)).toBe(true);
      }
    }
  });

  it("reads or refuses damaged ones", async () => {
    let read = 0;
    for (let number = 0; number < SAMPLE; number++) {
      read += Number(await judge(decoder, makeCase(decoder, new Random(number)), `case ${number}`));
    }
    // Damage that is never read only ever meets the first check.
    expect(read).toBeGreaterThan(SAMPLE / 50);
    expect(read).toBeLessThan(SAMPLE);
  }, 60_000);
});

describe("what was found", () => {
  const refuses = (run: () => unknown, says: string): void => {
    expect(() => interruptible(run)).toThrow(expect.objectContaining({ tag: "corrupt", what: expect.stringContaining(says) }));
  };

  it("a bomb of a gigabyte is given up at once", () => {
    // Blocks that end on a byte and refer to nothing before them can be put one behind another.
    const block = new Uint8Array(deflateRawSync(new Uint8Array(1 << 24), { finishFlush: constants.Z_FULL_FLUSH }));
    const bomb = joined(...new Array<Uint8Array>(64).fill(block));
    const before = process.memoryUsage().arrayBuffers;
    refuses(() => inflate(bomb, 1000, "bomb"), "does not unpack");
    expect(process.memoryUsage().arrayBuffers - before).toBeLessThan(INFLATE_ROOM);
  });

  it("streams longer than a piece come out whole", () => {
    const content = new Random(3).bytes(300_000).map((byte) => byte >> 3);
    expect(inflate(deflated(content), content.length, "")).toEqual(content);
    for (const length of [content.length - 1, content.length + 1]) refuses(() => inflate(deflated(content), length, ""), "does not unpack");
    refuses(() => inflate(deflated(content).slice(0, -9), content.length, ""), "unpack");
  });

  const cell = (key: string, children: string[], more = {}): object => ({ key, bounds: [[0, 0, 0], [1, 1, 1]], error: 1, children, ...more });
  const tile = (root: string, cells: object[]): Uint8Array =>
    INDEX_TEXT.close(below("index")[0]!, new TextEncoder().encode(JSON.stringify({ root, cells })));

  it("cells below themselves or below two parents", () => {
    refuses(() => index(tile("1/0/0/0", [cell("1/0/0/0", ["1/0/0/0"])])), "cannot be");
    refuses(() => index(tile("1/0/0/0", [cell("1/0/0/0", ["0/0/0/0"])])), "without the cells");
    refuses(() => index(tile("1/-1/0/0", [cell("1/-1/0/0", ["0/0/0/0"]), cell("0/0/0/0", [])])), "not below");
    refuses(() => index(tile("1/0/0/0", [cell("1/0/0/0", [], { hash: "../../.." })])), "cannot be");
    refuses(() => index(tile("1/0/0/0", [cell("1/0/0/0", []), cell("1/0/0/0", [])])), "once");
  });

  const changed = (change: (json: Record<string, never[]>) => void): Uint8Array => {
    const glb = below("mesh")[0]!;
    const json = JSON.parse(text(GLB_JSON.open(glb)!)) as Record<string, never[]>;
    change(json);
    return GLB_JSON.close(glb, new TextEncoder().encode(JSON.stringify(json)));
  };

  it.each<[string, Record<string, unknown>]>([
    ["an image", { images: [{ uri: "https://example.org/pixel.png" }] }],
    ["an image", { images: [{ uri: "../texture/../secret" }] }],
    ["a buffer", { buffers: [{ uri: "https://example.org/a.bin", byteLength: 4 }] }],
    ["a node", { nodes: [{ children: [0] }] }],
    ["a primitive", { accessors: [{ componentType: 5126, count: 2 ** 30, type: "VEC4" }] }],
    ["an accessor", { accessors: [{ bufferView: 0, componentType: 5126, count: 1, type: "VEC4", sparse: {} }] }],
    ["more than", { animations: [{}] }],
    ["a primitive", { meshes: [{ primitives: [{ attributes: { POSITION: 99 }, indices: 0 }] }] }],
  ])("%s that a reader of glTF would follow", (says, members) => {
    refuses(() => checkGlb(changed((json) => Object.assign(json, members)), "glb"), says);
  });

  it("near models are checked before they are read", async () => {
    const glb = changed((json) => Object.assign(json, { images: [{ uri: "https://example.org/pixel.png" }] }));
    await expect(parseNearModel(glb, "glb", shelf)).rejects.toMatchObject({ tag: "corrupt", what: "near geometry is damaged: an image" });
  });

  it.each(NEAR)("compressed near geometry is read, and none whose head claims too much", (glb) => {
    checkGlb(glb, "near");
    const body = GLB_BODY.open(glb)!;
    const head = body.findIndex((_, at) => text(body.subarray(at, at + 5)) === "DRACO");
    const claimed = (...bytes: number[]): Uint8Array => {
      const other = body.slice();
      other.set(bytes, head + 12);
      return GLB_BODY.close(glb, other);
    };
    refuses(() => checkGlb(claimed(255, 255, 255, 255, 7), "near"), "a primitive");
    refuses(() => checkGlb(claimed(255, 255, 255, 255, 255, 255), "near"), "a primitive");
    const more = (text_: string): string => text_.replace(/"count":\s?\d+/g, '"count":99999999');
    refuses(() => checkGlb(GLB_JSON.close(glb, new TextEncoder().encode(more(text(GLB_JSON.open(glb)!)))), "near"), "");
  });

  it("views that share the bytes of the file", () => {
    refuses(() => checkGlb(changed(({ bufferViews }) => bufferViews!.push(...bufferViews!)), "glb"), "share their bytes");
  });
});
