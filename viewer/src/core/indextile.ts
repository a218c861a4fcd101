import { corrupt } from "./errors.js";
import { parseKey } from "./grid.js";
import { isBounds, isCount, isHash, isList, isMetres, isObject, type Json } from "./limits.js";
import { unpack } from "./packed.js";
import type { Vector3 } from "./vector.js";

/** "FFIX". */
const PACKED = { magic: 0x58494646, largest: 64 << 20, name: "an index tile" };
/** From the gain of one picked tile to the next. */
const WORST_STEPS = 255;
const VIEW_BINS = 26;
/** Code of the character that stands for 0 where a text lists numbers. */
const ZERO = 35;
/** Meshes of which a leaf lists instances, and of each as many; forms of a mesh. */
const MOST_INSTANCES = 16;
const MOST_LEVELS = 16;
/** Impostors of a mesh, images of each, and rows of these. */
const MOST_IMPOSTORS = 4;
const MOST_SIDES = 32;
const MOST_ROWS = 4096;

/**
 * Errors of a leaf's levels are told for views from where a pixel is as wide as one of its pictures, then so many times as narrow; of those
 * of a cell above from where it is FARTHEST times as wide as one of that cell's own.
 */
export const ERROR_SPACING = 4;
/** Pixels of a cell's pictures for one of the screen, in the first view that their errors are told for. */
export const FARTHEST = 2;
/** Pixels of a leaf's pictures for one of the screen, in the first view that errors of shared meshes are told for. */
export const MESH_FARTHEST = 4;

/** A form of a cell's geometry, which shows it without any of the others. */
export interface GeometryLevel {
  readonly hash: string;
  readonly bytes: number;
  readonly triangles: number;
  readonly instances: number;
  /** Hash and bytes of each mesh its instances need. */
  readonly meshes: readonly (readonly [string, number])[];
  /** Hash and bytes of each image that it and those meshes need. */
  readonly textures?: readonly (readonly [string, number])[];
  /** How unlike the full geometry it looks, 255 = as nothing, see ERROR_SPACING. */
  readonly errors?: readonly number[];
  /** Triangles with those of its instances; 0 or left out: older worlds do not tell. */
  readonly drawn?: number;
}

/** Near geometry of a leaf, or the geometry of all that lies below a cell above. */
export interface GeometryEntry extends GeometryLevel {
  /** The same with fewer triangles and smaller images, from fine to coarse. */
  readonly levels?: readonly GeometryLevel[];
  /**
   * Above the leaves: how much of what is to be seen of the cell instances take that leaves below list, which no form shows; 255 = all.
   * Older worlds: left out.
   */
  readonly listed?: number;
}

/** A BlockMap: all that is in a cell, instances too, from any side. */
export interface BlockMapEntry {
  readonly hash: string;
  readonly bytes: number;
  /** As CellEntry.errors: how unlike the full geometry it looks. */
  readonly errors?: readonly number[];
}

/** A shared mesh in one of its forms, which shows all of it. */
export interface MeshLevel {
  readonly hash: string;
  readonly bytes: number;
  readonly triangles: number;
  /** Hash and bytes of each image that it needs. */
  readonly textures?: readonly (readonly [string, number])[];
  /**
   * How unlike the full mesh it looks, 255 = as nothing, from where a pixel is MESH_FARTHEST times as wide as one of the leaf's
   * pictures, then ERROR_SPACING times as narrow, and again; left out: it is the full one.
   */
  readonly errors?: readonly number[];
}

/** Images of a shared mesh from round about, one board each. */
export interface Impostor {
  /** Of each image, along the height of the mesh's bounds. */
  readonly rows: number;
  /** Hash and bytes of each; number n of k is seen from an azimuth of n k-ths of a turn in the mesh's frame, 0 along x. */
  readonly images: readonly (readonly [string, number])[];
  /** As those of a MeshLevel. */
  readonly errors?: readonly number[];
}

/** Instances of a shared mesh that have their place in a leaf, each in one alone. */
export interface InstancedMesh {
  /** Of the mesh, in its own frame. */
  readonly bounds: readonly [Vector3, Vector3];
  /** From fine to coarse, the full mesh first. */
  readonly levels: readonly MeshLevel[];
  /** For each instance the object id of the mesh's object 0. */
  readonly objects: readonly number[];
  /** For each instance three rows of four, from the mesh's frame to that of the leaf's lower corner. */
  readonly transforms: readonly (readonly number[])[];
  /** From fine to coarse. */
  readonly impostors?: readonly Impostor[];
}

/** One cell of the index, as it is written; members equal to their default may be left out. */
export interface CellEntry {
  readonly key: string;
  readonly bounds: readonly [Vector3, Vector3];
  readonly error: number;
  readonly hash?: string;
  /** (direction, layer, bytes) of each orthoview tile. */
  readonly tiles?: readonly (readonly [number, number, number])[];
  /**
   * For each of 26 view bins the tiles to draw, best first: how many, the places in `tiles` of all of them, and steps down to their gains;
   * each number a character, see ZERO.
   */
  readonly picked?: readonly string[];
  /** Of older worlds: for each of 26 view bins the directions to draw, best first. */
  readonly views?: readonly (readonly number[])[];
  /** Of older worlds: for each of 26 view bins the tiles to draw, best first: (place in `tiles`, steps down to its gain), flat. */
  readonly picks?: readonly (readonly number[])[];
  readonly children?: readonly string[];
  readonly index?: string;
  readonly geometry?: GeometryEntry | null;
  /** Where there are no tiles it takes their place, its errors that of theirs. */
  readonly blockmap?: BlockMapEntry | null;
  /** Of a leaf: what is placed in it, so that it can be drawn before, and without, the leaf's geometry. */
  readonly instances?: readonly InstancedMesh[];
  /** How unlike the full geometry its pictures look, 255 = as nothing, see ERROR_SPACING. */
  readonly errors?: readonly number[];
  /** For each of `children` how unlike its own pictures these look in their place, 255 = as nothing. */
  readonly losses?: readonly number[];
}

/**
 * Reads an index tile; allocates at most 64 bytes for each byte of JSON that the header declares, which is at most 64 MiB, and what
 * `inflate` takes. Throws `corrupt` for anything else.
 */
export function decodeIndexTile(bytes: Uint8Array, where: string): readonly CellEntry[] {
  const { root, cells } = parse(new TextDecoder().decode(unpack(bytes, PACKED, where)), where);
  if (!Array.isArray(cells) || cells.length === 0) throw corrupt("index tile without cells", where);
  for (const cell of cells) checkCell(cell, where);
  const names = new Set((cells as CellEntry[]).map(({ key }) => key));
  if (names.size !== cells.length || (cells[0] as CellEntry).key !== root) {
    throw corrupt("index tile does not list each of its cells once, the root first", where);
  }
  for (const { key, index, children } of cells as CellEntry[]) {
    if (!index && children?.some((child) => !names.has(child))) throw corrupt(`index tile without the cells below ${key}`, where);
  }
  return cells as CellEntry[];
}

function parse(text: string, where: string): Json {
  try {
    const found: unknown = JSON.parse(text);
    if (isObject(found)) return found;
  } catch {
    // No JSON at all, or nested deeper than the stack: the same to the caller.
  }
  throw corrupt("index tile without JSON", where);
}

/** Throws `corrupt` unless every member is of its type and within its limits: what draws a frame does not look again. */
function checkCell(cell: unknown, where: string): void {
  if (!isObject(cell) || typeof cell["key"] !== "string") throw corrupt("index tile tells of no cell", where);
  const { key, bounds, error, hash = "", tiles = [], views = [], picked, picks = unpackPicks(picked), children = [], index = "", geometry = null, blockmap = null, instances = [], errors = [], losses = [] } = cell;
  const { level } = parseKey(key as string);
  const sane =
    isBounds(bounds) && isMetres(error) && error >= 0 && isHashOrNone(hash) && isHashOrNone(index) && isList(errors, isError, 8) &&
    isList(losses, isError, 8) && (losses.length === 0 || losses.length === (children as readonly string[]).length) &&
    isList(tiles, isTile, 512) && isList(views, isBin, 26) && (geometry === null || isGeometry(geometry)) && (blockmap === null || isBlockMap(blockmap)) &&
    isList(instances, isInstanced, MOST_INSTANCES) &&
    isList(picks, (bin) => arePicks(bin, tiles.length), VIEW_BINS) && isList(children, isString, 8) && new Set(children).size === children.length &&
    children.every((child) => parseKey(child).level === level - 1);
  if (!sane) throw corrupt(`index tile tells what cannot be of cell ${String(key)}`, where);
}

function isString(value: unknown): value is string {
  return typeof value === "string";
}

function isHashOrNone(value: unknown): value is string {
  return value === "" || isHash(value);
}

function isDirection(value: unknown): value is number {
  return isCount(value, 255);
}

function isBin(value: unknown): value is readonly number[] {
  return isList(value, isDirection, 256);
}

/** Of a cell, for each view bin, the tiles to draw, best first: (place in `tiles`, steps down to its gain), flat. */
export function listedPicks({ picked, picks }: CellEntry): readonly (readonly number[])[] {
  return picks ?? unpackPicks(picked) ?? [];
}

/** The same of CellEntry.picked; null: it is not as many as it says. */
function unpackPicks(picked: unknown): readonly (readonly number[])[] | null {
  if (picked === undefined) return [];
  if (!isList(picked, isString, 3) || picked.length < 3 || picked[0]!.length > VIEW_BINS) return null;
  const [counts, places, steps] = picked.map((text) => Array.from(text, (letter) => letter.codePointAt(0)! - ZERO)) as [number[], number[], number[]];
  if (counts.some((count) => count < 0) || counts.reduce((sum, count) => sum + count, 0) !== places.length || steps.length !== places.length) return null;
  let first = 0;
  return counts.map((count) => {
    first += count;
    return places.slice(first - count, first).flatMap((place, n) => [place, steps[first - count + n]!]);
  });
}

/** Whether they come in pairs, name tiles that exist, each once, and steps between gains. */
function arePicks(value: unknown, tiles: number): value is readonly number[] {
  if (!isList(value, isPickNumber, 1024) || value.length % 2 !== 0) return false;
  const places = value.filter((_, n) => n % 2 === 0);
  const steps = value.filter((_, n) => n % 2 === 1);
  return new Set(places).size === places.length && places.every((place) => place < tiles) && steps.every((step) => step <= WORST_STEPS);
}

function isPickNumber(value: unknown): value is number {
  return isCount(value, 511);
}

function isTile(value: unknown): value is readonly [number, number, number] {
  return Array.isArray(value) && value.length === 3 && isDirection(value[0]) && isCount(value[1], 1) && isCount(value[2]);
}

function isMesh(value: unknown): value is readonly [string, number] {
  return Array.isArray(value) && value.length === 2 && isHash(value[0]) && isCount(value[1]);
}

function isGeometry(value: unknown): boolean {
  return isLevel(value) && isList(value["levels"] ?? [], isLevel, MOST_LEVELS) && isError(value["listed"] ?? 0);
}

function isBlockMap(value: unknown): boolean {
  return isObject(value) && isHash(value["hash"]) && isCount(value["bytes"]) && isList(value["errors"] ?? [], isError, 8);
}

function isLevel(value: unknown): value is Json {
  if (!isObject(value)) return false;
  const { hash, bytes, triangles = 0, instances = 0, meshes = [], textures = [], errors = [], drawn = 0 } = value;
  const counted = [bytes, triangles, instances, drawn].every((count) => isCount(count));
  return isHash(hash) && counted && isList(meshes, isMesh) && isList(textures, isMesh) && isList(errors, isError, 8);
}

/** Whether each has a place, and the mesh a size and a form. */
function isInstanced(value: unknown): value is InstancedMesh {
  if (!isObject(value)) return false;
  const { bounds, levels, objects, transforms, impostors = [] } = value;
  const placed = isList(objects, isObjectId, MOST_INSTANCES) && isList(transforms, isTransform, MOST_INSTANCES) && objects.length === transforms.length;
  const shown = isList(levels, isMeshLevel, MOST_LEVELS) && levels.length > 0 && isList(impostors, isImpostor, MOST_IMPOSTORS);
  return placed && isBounds(bounds) && shown;
}

function isMeshLevel(value: unknown): value is MeshLevel {
  if (!isObject(value)) return false;
  const { hash, bytes, triangles, textures = [], errors = [] } = value;
  return isHash(hash) && isCount(bytes) && isCount(triangles) && isList(textures, isMesh) && isList(errors, isError, 8);
}

function isImpostor(value: unknown): value is Impostor {
  if (!isObject(value)) return false;
  const { rows, images, errors = [] } = value;
  return isCount(rows, MOST_ROWS) && rows > 0 && isList(images, isMesh, MOST_SIDES) && images.length > 0 && isList(errors, isError, 8);
}

function isObjectId(value: unknown): value is number {
  return isCount(value);
}

function isTransform(value: unknown): value is readonly number[] {
  return isList(value, isMetres, 12) && value.length === 12;
}

function isError(value: unknown): value is number {
  return isCount(value, 255);
}
