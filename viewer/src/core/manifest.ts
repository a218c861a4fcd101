import { axesOf, type Axes } from "./directions.js";
import { FarfieldError } from "./errors.js";
import { Grid, parseKey, type CellKey } from "./grid.js";
import { boxOf, isCount, isHash, isVector, MAXIMUM_LEVEL, type Json } from "./limits.js";
import { readServers, type ServerRule } from "./serverrule.js";
import type { Box, Vector3 } from "./vector.js";

const FORMAT = "farfield-world";
const VERSION = 1;

/** A baked direction. */
export interface Direction {
  readonly number: number;
  readonly vector: Vector3;
  readonly axes: Axes;
}

/** A camera; `fov` is vertical, degrees. */
export interface View {
  readonly eye: Vector3;
  readonly target: Vector3;
  readonly fov?: number;
}

/** What a world is and where its index starts (spec/world.md, Manifest). */
export interface Manifest {
  /** What it was read from; tells it from every other. */
  readonly text: string;
  readonly generation: number;
  readonly name: string;
  readonly crs: string | null;
  readonly origin: Vector3;
  readonly bounds: Box;
  readonly grid: Grid;
  readonly directions: ReadonlyMap<number, Direction>;
  readonly depthLayers: number;
  readonly indexDepth: number;
  /** Leaves nearer than this times r are geometry, unless one is told otherwise. */
  readonly near: number;
  readonly roots: readonly { readonly key: CellKey; readonly hash: string }[];
  readonly credits: readonly string[];
  readonly view: View | null;
  /** Hash of the index of attributes; null: objects have none. */
  readonly attributes: string | null;
  /** Over which servers the world is split; null: everything is where the manifest is. */
  readonly servers: ServerRule | null;
}

/** Whether the cells and pictures of two generations have the same places, so that one can be shown beside the other. */
export function sameFrame(a: Manifest, b: Manifest): boolean {
  const frameOf = ({ grid, directions, crs, origin, servers }: Manifest): string =>
    JSON.stringify([grid, [...directions.values()].map(({ number, vector }) => [number, vector]), crs, origin, servers]);
  return frameOf(a) === frameOf(b);
}

/** Reads a manifest; allocates at most 64 bytes for each character of it. Throws `not-a-world` or, when a newer farfield wrote or split it, `version`. */
export function decodeManifest(text: string, where: string): Manifest {
  const hint = "is this the address of a baked world?";
  let head: Json;
  try {
    head = JSON.parse(text) as Json;
  } catch {
    throw new FarfieldError("not-a-world", "not a manifest: no JSON", where, hint);
  }
  if (head === null || typeof head !== "object" || head["format"] !== FORMAT) {
    throw new FarfieldError("not-a-world", "not the manifest of a farfield world", where, hint);
  }
  const version = head["version"];
  if (typeof version === "number" && version > VERSION) {
    const what = `world of version ${String(version)}, this viewer reads up to ${VERSION}`;
    throw new FarfieldError("version", what, where, "upgrade farfield");
  }
  try {
    if (version !== VERSION) throw new Error("without a version");
    return read(head, text, where);
  } catch (error) {
    if (error instanceof FarfieldError && error.tag === "version") throw error;
    const what = `damaged manifest: ${error instanceof Error ? error.message : String(error)}`;
    throw new FarfieldError("not-a-world", what, where, "bake the world again");
  }
}

function read(head: Json, text: string, where: string): Manifest {
  const grid = readGrid(object(head["grid"], "grid"));
  const bounds = boxOf(head["bounds"]);
  const { index_depth: indexDepth = 4, depth_layers: depthLayers = 2, generation = 1, near = 1 } = head;
  if (!bounds) throw new Error("bounds");
  if (!isCount(indexDepth, 16) || indexDepth < 2) throw new Error("index_depth");
  if (depthLayers !== 1 && depthLayers !== 2) throw new Error("depth_layers");
  if (!isCount(generation)) throw new Error("generation");
  const { attributes = null } = head;
  if (attributes !== null && !isHash(attributes)) throw new Error("attributes");
  if (typeof near !== "number" || !(near > 0 && near <= 1)) throw new Error("near");
  return {
    text,
    generation,
    name: String(head["name"] ?? ""),
    crs: typeof head["crs"] === "string" ? head["crs"] : null,
    origin: vector(head["origin"] ?? [0, 0, 0], "origin"),
    bounds,
    grid,
    directions: new Map(list(head["directions"], "directions").map(readDirection).map((d) => [d.number, d])),
    depthLayers,
    indexDepth,
    near,
    roots: readRoots(list(head["roots"] ?? [], "roots"), grid),
    credits: list(head["credits"] ?? [], "credits").map(String),
    view: head["view"] == null ? null : readView(object(head["view"], "view")),
    attributes,
    servers: head["servers"] === undefined ? null : readServers(head["servers"], where),
  };
}

/** The roots: different ones of the 8 cells of the highest level. */
function readRoots(entries: unknown[], grid: Grid): Manifest["roots"] {
  const roots = entries.map((entry) => {
    const { key, hash } = object(entry, "roots");
    const cell = parseKey(String(key));
    const first = [cell.x, cell.y, cell.z].every((index) => index === 0 || index === -1);
    if (!isHash(hash) || cell.level !== grid.topLevel || !first) throw new Error("roots");
    return { key: cell, hash };
  });
  if (new Set(roots.map(({ key: { x, y, z } }) => `${x} ${y} ${z}`)).size !== roots.length) throw new Error("roots");
  return roots;
}

function readGrid(grid: Json): Grid {
  const axisLevels = vector(grid["axis_levels"], "axis_levels");
  const { leaf_size: leafSize, resolution } = grid;
  const sane =
    typeof leafSize === "number" && leafSize >= 1e-6 && leafSize <= 1e9 &&
    isCount(resolution, 4096) && resolution >= 1 &&
    axisLevels.every((n) => isCount(n, MAXIMUM_LEVEL));
  if (!sane) throw new Error("grid out of range");
  return new Grid(leafSize, resolution, vector(grid["corner"], "corner"), axisLevels);
}

function readDirection(entry: unknown): Direction {
  const direction = object(entry, "directions");
  const e = vector(direction["vector"], "vector");
  const number = direction["number"];
  if (!isCount(number, 255) || Math.abs(Math.hypot(...e) - 1) > 1e-3) throw new Error("directions");
  return { number, vector: e, axes: axesOf(e) };
}

function readView(view: Json): View {
  const eye = vector(view["eye"], "view.eye");
  const target = vector(view["target"], "view.target");
  const fov = view["fov"] ?? 50;
  if (typeof fov !== "number" || fov <= 0 || fov >= 180) throw new Error("view.fov");
  return view["fov"] == null ? { eye, target } : { eye, target, fov };
}

function object(value: unknown, name: string): Json {
  if (value === null || typeof value !== "object" || Array.isArray(value)) throw new Error(name);
  return value as Json;
}

function list(value: unknown, name: string): unknown[] {
  if (!Array.isArray(value)) throw new Error(name);
  return value;
}

function vector(value: unknown, name: string): Vector3 {
  if (!isVector(value)) throw new Error(name);
  return value;
}
