import { parseKey, type CellKey } from "./grid.js";

const INDEX = /(?:0|-?[1-9][0-9]{0,12})/.source;
const OF_CELL = new RegExp(`^[a-z]+/((?:0|[1-9][0-9]?)/${INDEX}/${INDEX}/${INDEX})(?:[-/].+)?$`);
const DYNAMIC = /^impostor\/([0-9a-f]{16})-([1-9][0-9]{0,3})-(0|[1-9][0-9]?)-([0-8])$/;

/** Names of a world's values in its store (spec/world.md). `cell` is "level/x/y/z". */
export const orthoviewKey = (cell: string, direction: number, layer: number, hash: string): string =>
  `orthoview/${cell}/${direction}/${layer}-${hash}`;
export const indexKey = (cell: string, hash: string): string => `index/${cell}-${hash}`;
export const geometryKey = (cell: string, hash: string): string => `geometry/${cell}-${hash}`;
export const blockMapKey = (cell: string, hash: string): string => `blockmap/${cell}-${hash}`;
/** Object ids of the BlockMap of that hash. */
export const blockMapObjectsKey = (cell: string, hash: string): string => `objects/${cell}/blockmap-${hash}`;
/** Object ids of one layer of one orthoview. */
export const objectsKey = (cell: string, direction: number, layer: number, hash: string): string => `objects/${cell}/${direction}/${layer}-${hash}`;
export const attributesKey = (hash: string): string => `attributes/${hash}`;
export const meshKey = (hash: string): string => `mesh/${hash}`;
export const textureKey = (hash: string): string => `texture/${hash}`;

/** An image of a shared mesh that a server makes on demand; it comes in sessions alone (spec/stream.md). */
export interface DynamicImpostor {
  /** Hash of the full mesh. */
  readonly mesh: string;
  /** Pixels for the height of the mesh's box. */
  readonly rows: number;
  /** Azimuth of the eye, sixteenths of a turn. */
  readonly turn: number;
  /** Its elevation, eighths of half a turn from straight below. */
  readonly tilt: number;
}

/** What the key of a dynamic impostor names; null: it is another key. */
export function dynamicOf(key: string): DynamicImpostor | null {
  const found = DYNAMIC.exec(key);
  if (!found) return null;
  const [rows, turn, tilt] = found.slice(2).map(Number) as [number, number, number];
  return turn < 16 ? { mesh: found[1]!, rows, turn, tilt } : null;
}

/** The cell that a value belongs to; null: it belongs to none. */
export function cellOf(key: string): CellKey | null {
  const name = OF_CELL.exec(key)?.[1];
  if (name === undefined) return null;
  try {
    return parseKey(name);
  } catch {
    // Too far up or out to be a cell.
    return null;
  }
}

/** Whether a key is an image's. */
export function isTexture(key: string): boolean {
  return key.startsWith("texture/");
}

export function hashOfTexture(key: string): string {
  return key.slice("texture/".length);
}
