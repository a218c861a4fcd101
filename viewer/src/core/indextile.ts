import { crc32 } from "./crc32.js";
import { corrupt } from "./errors.js";
import { parseKey } from "./grid.js";
import { inflate } from "./inflate.js";
import { isBounds, isCount, isHash, isList, isMetres, isObject, type Json } from "./limits.js";
import type { Vector3 } from "./vector.js";

const HEADER_BYTES = 16;
const MAGIC = 0x58494646; // "FFIX"
/** Version 1, and a reserved zero. */
const VERSION = 1;
const MAXIMUM_BYTES = 64 << 20;
/** From the gain of one picked tile to the next. */
const WORST_STEPS = 255;

/** Near geometry of a leaf. */
export interface GeometryEntry {
  readonly hash: string;
  readonly bytes: number;
  readonly triangles: number;
  readonly instances: number;
  /** Hash and bytes of each mesh its instances need. */
  readonly meshes: readonly (readonly [string, number])[];
}

/** One cell of the index, as it is written; members equal to their default may be left out. */
export interface CellEntry {
  readonly key: string;
  readonly bounds: readonly [Vector3, Vector3];
  readonly error: number;
  readonly hash?: string;
  /** (direction, layer, bytes) of each orthoview tile. */
  readonly tiles?: readonly (readonly [number, number, number])[];
  /** For each of 26 view bins the directions to draw, best first. */
  readonly views?: readonly (readonly number[])[];
  /** For each of 26 view bins the tiles to draw, best first: (place in `tiles`, steps down to its gain), flat. */
  readonly picks?: readonly (readonly number[])[];
  readonly children?: readonly string[];
  readonly index?: string;
  readonly geometry?: GeometryEntry | null;
}

/**
 * Reads an index tile; allocates at most 64 bytes for each byte of JSON that the header declares, which is at most 64 MiB, and what
 * `inflate` takes. Throws `corrupt` for anything else.
 */
export function decodeIndexTile(bytes: Uint8Array, where: string): readonly CellEntry[] {
  const { root, cells } = parse(textOf(bytes, where), where);
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

/** The JSON. Throws `corrupt`. */
function textOf(bytes: Uint8Array, where: string): string {
  if (bytes.length < HEADER_BYTES) throw corrupt("index tile is cut short", where);
  const header = new DataView(bytes.buffer, bytes.byteOffset, HEADER_BYTES);
  const length = header.getUint32(8, true);
  if (header.getUint32(0, true) !== MAGIC || header.getUint32(4, true) !== VERSION || length > MAXIMUM_BYTES) {
    throw corrupt("not an index tile of a known version", where);
  }
  const text = inflate(bytes.subarray(HEADER_BYTES), length, where);
  if (crc32(text) !== header.getUint32(12, true)) throw corrupt("index tile is damaged", where);
  return new TextDecoder().decode(text);
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
  const { key, bounds, error, hash = "", tiles = [], views = [], picks = [], children = [], index = "", geometry = null } = cell;
  const { level } = parseKey(key as string);
  const sane =
    isBounds(bounds) && isMetres(error) && error >= 0 && isHashOrNone(hash) && isHashOrNone(index) &&
    isList(tiles, isTile, 512) && isList(views, isBin, 26) && (geometry === null || isGeometry(geometry)) &&
    isList(picks, (bin) => arePicks(bin, tiles.length), 26) && isList(children, isString, 8) && new Set(children).size === children.length &&
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
  if (!isObject(value)) return false;
  const { hash, bytes, triangles = 0, instances = 0, meshes = [] } = value;
  return isHash(hash) && [bytes, triangles, instances].every((count) => isCount(count)) && isList(meshes, isMesh);
}
