import { deflateRawSync } from "node:zlib";
import { describe, expect, it } from "vitest";
import * as core from "../src/core/index.js";
import { crc32 } from "../src/core/crc32.js";
import { listedPicks } from "../src/core/indextile.js";
import { airOf, readHash, writeHash } from "../src/app/hash.js";
import { defaultOptions } from "../src/three/options.js";
import { aimOf, overview, reachOf } from "../src/app/pose.js";

const MANIFEST = {
  format: "farfield-world", version: 1, generation: 3, name: "town", crs: null, origin: [0, 0, 0],
  bounds: [[0, 0, 0], [8, 8, 2]],
  grid: { leaf_size: 4, resolution: 64, corner: [-1, -1, -1], axis_levels: [2, 2, 0] },
  directions: [{ number: 22, vector: [0, 0, 1] }],
  depth_layers: 2, index_depth: 4, roots: [{ key: "2/0/0/0", hash: "00000000000000aa" }], credits: ["someone"],
};

describe("decodeManifest", () => {
  const read = (changes: object): core.Manifest => core.decodeManifest(JSON.stringify({ ...MANIFEST, ...changes }), "here");

  it("reads what the bake writes", () => {
    const manifest = read({ view: { eye: [1, 2, 3], target: [4, 5, 6] }, unknown: 1 });
    expect(manifest).toMatchObject({ name: "town", generation: 3, credits: ["someone"], view: { eye: [1, 2, 3] } });
    expect(manifest.grid.pitch(1)).toBe(0.125);
    expect(manifest.directions.get(22)!.axes).toEqual({ u: [1, 0, 0], v: [0, -1, 0], w: [-0, -0, -1] });
  });

  it.each([
    ["no JSON", "not-a-world", "<html>"],
    ["something else", "not-a-world", "{}"],
    ["a newer version", "version", JSON.stringify({ ...MANIFEST, version: 2 })],
    ["an absurd grid", "not-a-world", JSON.stringify({ ...MANIFEST, grid: { ...MANIFEST.grid, resolution: 0 } })],
    ["bounds that are none", "not-a-world", JSON.stringify({ ...MANIFEST, bounds: [[0, 0], 1] })],
  ])("refuses %s", (_, tag, text) => {
    expect(() => core.decodeManifest(text, "here")).toThrow(expect.objectContaining({ tag, where: "here" }));
  });
});

describe("decodeIndexTile", () => {
  const tile = (content: object): Uint8Array => {
    const text = new TextEncoder().encode(JSON.stringify(content));
    const bytes = new Uint8Array([...new Uint8Array(16), ...deflateRawSync(text)]);
    const header = new DataView(bytes.buffer);
    header.setUint32(0, 0x58494646, true);
    header.setUint16(4, 1, true);
    header.setUint32(8, text.length, true);
    header.setUint32(12, crc32(text), true);
    return bytes;
  };

  it("reads cells", () => {
    const cell = { key: "0/0/0/0", bounds: [[0, 0, 0], [1, 1, 1]], error: 0.5 };
    expect(core.decodeIndexTile(tile({ root: "0/0/0/0", cells: [cell] }), "here")).toEqual([cell]);
  });

  const LEVEL = { hash: "0123456789abcdef", bytes: 5, triangles: 2 };
  const PLACE = [1, 0, 0, 4.5, 0, 1, 0, -1e12, 0, 0, 1, 1e12];
  const PLACED = { bounds: [[0, 0, 0], [1, 1, 1]], levels: [LEVEL, { ...LEVEL, textures: [[LEVEL.hash, 9]], errors: [0, 255] }], objects: [1], transforms: [PLACE] };
  const placing = (...instances: unknown[]): Uint8Array =>
    tile({ root: "0/0/0/0", cells: [{ key: "0/0/0/0", bounds: [[0, 0, 0], [1, 1, 1]], error: 0.5, instances }] });
  const times = <T>(count: number, item: T): T[] => new Array<T>(count).fill(item);

  it("reads what is placed in leaves", () => {
    const most = { ...PLACED, levels: times(16, LEVEL), objects: times(16, 1), transforms: times(16, PLACE) };
    const nothing = { ...PLACED, objects: [], transforms: [] };
    const instances = [PLACED, nothing, ...times(14, most)];
    expect(core.decodeIndexTile(placing(...instances), "here")[0]!.instances).toEqual(instances);
  });

  const IMPOSTOR = { rows: 96, images: [[LEVEL.hash, 940]] };

  it("reads images of what is placed from round about", () => {
    const most = { rows: 4096, images: times(32, [LEVEL.hash, 0]), errors: times(8, 255) };
    const instances = [{ ...PLACED, impostors: times(4, most) }, { ...PLACED, impostors: [{ ...IMPOSTOR, rows: 1 }] }, { ...PLACED, impostors: [] }];
    expect(core.decodeIndexTile(placing(...instances), "here")[0]!.instances).toEqual(instances);
  });

  it.each<[string, unknown]>([
    ["no list", IMPOSTOR],
    ["too many", times(5, IMPOSTOR)],
    ["no object", [null]],
    ["no rows", [{ images: IMPOSTOR.images }]],
    ["no row at all", [{ ...IMPOSTOR, rows: 0 }]],
    ["too many rows", [{ ...IMPOSTOR, rows: 4097 }]],
    ["half a row", [{ ...IMPOSTOR, rows: 9.5 }]],
    ["no images", [{ rows: 96 }]],
    ["no image at all", [{ ...IMPOSTOR, images: [] }]],
    ["too many images", [{ ...IMPOSTOR, images: times(33, IMPOSTOR.images[0]) }]],
    ["an image that leads elsewhere", [{ ...IMPOSTOR, images: [["../../secret0000", 9]] }]],
    ["an image of no bytes", [{ ...IMPOSTOR, images: [[LEVEL.hash]] }]],
    ["an error beyond everything", [{ ...IMPOSTOR, errors: [256] }]],
    ["too many errors", [{ ...IMPOSTOR, errors: times(9, 1) }]],
  ])("refuses impostors that are %s", (_, impostors) => {
    expect(() => core.decodeIndexTile(placing({ ...PLACED, impostors }), "here")).toThrow(expect.objectContaining({ tag: "corrupt" }));
  });

  it.each<[string, unknown[]]>([
    ["too many meshes", times(17, PLACED)],
    ["no object", [null]],
    ["a list", [[]]],
    ["no bounds", [{ ...PLACED, bounds: undefined }]],
    ["bounds that are no box", [{ ...PLACED, bounds: [[0, 0, 2], [1, 1, 1]] }]],
    ["no levels", [{ ...PLACED, levels: [] }]],
    ["too many levels", [{ ...PLACED, levels: times(17, LEVEL) }]],
    ["a level without a count", [{ ...PLACED, levels: [{ hash: LEVEL.hash, bytes: 5 }] }]],
    ["a hash that leads elsewhere", [{ ...PLACED, levels: [{ ...LEVEL, hash: "../../secret0000" }] }]],
    ["bytes that are none", [{ ...PLACED, levels: [{ ...LEVEL, bytes: -1 }] }]],
    ["an image that is none", [{ ...PLACED, levels: [{ ...LEVEL, textures: [["x", 1]] }] }]],
    ["an error beyond everything", [{ ...PLACED, levels: [{ ...LEVEL, errors: [256] }] }]],
    ["too many errors", [{ ...PLACED, levels: [{ ...LEVEL, errors: times(9, 1) }] }]],
    ["an object without a place", [{ ...PLACED, objects: [1, 2] }]],
    ["a place without an object", [{ ...PLACED, transforms: [PLACE, PLACE] }]],
    ["too many instances", [{ ...PLACED, objects: times(17, 1), transforms: times(17, PLACE) }]],
    ["half an object", [{ ...PLACED, objects: [1.5] }]],
    ["no transforms", [{ ...PLACED, transforms: undefined }]],
    ["a place of eleven numbers", [{ ...PLACED, transforms: [PLACE.slice(1)] }]],
    ["a place of thirteen", [{ ...PLACED, transforms: [[...PLACE, 0]] }]],
    ["a place beyond the world", [{ ...PLACED, transforms: [PLACE.with(3, 1.1e12)] }]],
    ["a place of words", [{ ...PLACED, transforms: [PLACE.map(String)] }]],
  ])("refuses instances with %s", (_, instances) => {
    expect(() => core.decodeIndexTile(placing(...instances), "here")).toThrow(expect.objectContaining({ tag: "corrupt" }));
  });

  const picking = (picked: unknown): Uint8Array =>
    tile({ root: "0/0/0/0", cells: [{ key: "0/0/0/0", bounds: [[0, 0, 0], [1, 1, 1]], error: 1, tiles: [[3, 0, 9], [3, 1, 9], [5, 0, 9]], picked }] });

  it("reads picked tiles as Python writes them", () => {
    const [cell] = core.decodeIndexTile(picking(["%#$", "%#$", "'+\u0122"]), "here");
    expect(listedPicks(cell!)).toEqual([[2, 4, 0, 8], [], [1, 255]]);
    const { picked: _, ...without } = cell!;
    expect(listedPicks(without)).toEqual([]);
    expect(listedPicks({ ...without, picks: [[1, 2]] })).toEqual([[1, 2]]);
  });

  it.each<[string, unknown]>([
    ["fewer than said", ["%", "#", "#"]], ["more", ["$", "$$", "#"]], ["no places", ["$"]], ["too many", ["$", "#", "#", "#"]],
    ["below 0", ["$\"", "#", "#"]], ["27 bins", ["#".repeat(27), "", ""]], ["no such tile", ["$", "&", "#"]],
    ["too far down", ["$", "#", "\u0123"]], ["twice", ["%", "##", "##"]], ["numbers", [1, 2, 3]], ["no list", "$#"], ["nothing", null],
  ])("refuses picked tiles with %s", (_, picked) => {
    expect(() => core.decodeIndexTile(picking(picked), "here")).toThrow(expect.objectContaining({ tag: "corrupt" }));
  });

  it("refuses damage", () => {
    const good = tile({ root: "0/0/0/0", cells: [] });
    for (const at of [0, 4, 8, 12, good.length - 1]) {
      const bad = good.slice();
      bad[at]! ^= 1;
      expect(() => core.decodeIndexTile(bad, "here")).toThrow(expect.objectContaining({ tag: "corrupt" }));
    }
  });
});

describe("the address and the camera", () => {
  it("finds the view again that it kept", () => {
    const pose = { eye: [1.234, -5, 6] as const, target: [0, 0.5, 100000.25] as const, fov: 50 };
    const air = { sky: "clear", haze: 2500, shadows: true };
    const kept = readHash(writeHash({ pose, sun: [225, 35], air }), 40);
    expect(kept).toEqual({ pose: { ...pose, eye: [1.23, -5, 6] }, sun: [225, 35], air });
    expect(readHash("#eye=1,2&target=x&haze=-3&sky=red", 40)).toEqual({ pose: null, sun: null, air: {} });
  });

  it("says nothing of the air where it is as always", () => {
    expect(writeHash({ pose: null, sun: [225, 35], air: airOf(defaultOptions()) })).toBe("#sun=225,35");
  });

  it("frames a box from the south-west, looking down", () => {
    const { eye, target } = overview([0, 0, 0], [10, 10, 2], 4 / 3);
    expect(target).toEqual([5, 5, 1]);
    expect(eye[0]).toBeLessThan(0);
    expect(eye[1]).toBeCloseTo(eye[0]);
    const aim = aimOf({ eye, target, fov: 50 });
    expect((aim.pitch * 180) / Math.PI).toBeCloseTo(-25);
    reachOf(aim).forEach((part, n) => expect(part).toBeCloseTo(target[n]! - eye[n]!));
  });
});

it("the core's public names are these", () => {
  expect(Object.keys(core).sort()).toEqual([
    "ArchiveFetcher", "Cell", "FarfieldError", "Fetcher", "Grid", "PRINCIPAL", "SharedMeshes", "axesOf", "cut", "decodeIndexTile",
    "decodeManifest", "decodeTile", "formatKey", "nearRadius", "parseKey", "viewBin",
  ]);
});
