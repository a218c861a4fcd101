import { axesOf, type Axes } from "./directions.js";
import { FarfieldError } from "./errors.js";
import { Grid, parseKey, type CellKey } from "./grid.js";
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
  readonly generation: number;
  readonly name: string;
  readonly crs: string | null;
  readonly origin: Vector3;
  readonly bounds: Box;
  readonly grid: Grid;
  readonly directions: ReadonlyMap<number, Direction>;
  readonly depthLayers: number;
  readonly indexDepth: number;
  readonly roots: readonly { readonly key: CellKey; readonly hash: string }[];
  readonly credits: readonly string[];
  readonly view: View | null;
}

/** Whether the cells and pictures of two generations have the same places, so that one can be shown beside the other. */
export function sameFrame(a: Manifest, b: Manifest): boolean {
  const frameOf = ({ grid, directions, crs, origin }: Manifest): string =>
    JSON.stringify([grid, [...directions.values()].map(({ number, vector }) => [number, vector]), crs, origin]);
  return frameOf(a) === frameOf(b);
}

type Json = Record<string, unknown>;

/** Reads a manifest. Throws `not-a-world` or, when a newer farfield wrote it, `version`. */
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
  if (typeof version !== "number" || version > VERSION) {
    const what = `world of version ${String(version)}, this viewer reads up to ${VERSION}`;
    throw new FarfieldError("version", what, where, "upgrade farfield");
  }
  try {
    return read(head);
  } catch (error) {
    const what = `damaged manifest: ${error instanceof Error ? error.message : String(error)}`;
    throw new FarfieldError("not-a-world", what, where, "bake the world again");
  }
}

function read(head: Json): Manifest {
  const grid = readGrid(object(head["grid"], "grid"));
  const [lower, upper] = list(head["bounds"], "bounds");
  const indexDepth = head["index_depth"] ?? 4;
  if (!Number.isInteger(indexDepth) || (indexDepth as number) < 1) throw new Error("index_depth");
  return {
    generation: Number(head["generation"] ?? 1),
    name: String(head["name"] ?? ""),
    crs: typeof head["crs"] === "string" ? head["crs"] : null,
    origin: vector(head["origin"] ?? [0, 0, 0], "origin"),
    bounds: { lower: vector(lower, "bounds"), upper: vector(upper, "bounds") },
    grid,
    directions: new Map(list(head["directions"], "directions").map(readDirection).map((d) => [d.number, d])),
    depthLayers: Number(head["depth_layers"] ?? 2),
    indexDepth: indexDepth as number,
    roots: list(head["roots"] ?? [], "roots").map((entry) => {
      const root = object(entry, "roots");
      return { key: parseKey(String(root["key"])), hash: String(root["hash"]) };
    }),
    credits: list(head["credits"] ?? [], "credits").map(String),
    view: head["view"] == null ? null : readView(object(head["view"], "view")),
  };
}

function readGrid(grid: Json): Grid {
  const axisLevels = vector(grid["axis_levels"], "axis_levels");
  const { leaf_size: leafSize, resolution } = grid;
  const sane =
    typeof leafSize === "number" && leafSize > 0 &&
    typeof resolution === "number" && resolution >= 1 && resolution <= 4096 &&
    axisLevels.every((n) => Number.isInteger(n) && n >= 0 && n <= 40);
  if (!sane) throw new Error("grid out of range");
  return new Grid(leafSize, resolution, vector(grid["corner"], "corner"), axisLevels);
}

function readDirection(entry: unknown): Direction {
  const direction = object(entry, "directions");
  const e = vector(direction["vector"], "vector");
  return { number: Number(direction["number"]), vector: e, axes: axesOf(e) };
}

function readView(view: Json): View {
  const eye = vector(view["eye"], "view.eye");
  const target = vector(view["target"], "view.target");
  return typeof view["fov"] === "number" ? { eye, target, fov: view["fov"] } : { eye, target };
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
  if (!Array.isArray(value) || value.length !== 3 || !value.every(Number.isFinite)) throw new Error(name);
  return value as unknown as Vector3;
}
