import { parseKey, type CellKey } from "./grid.js";

const INDEX = /(?:0|-?[1-9][0-9]{0,12})/.source;
const OF_CELL = new RegExp(`^[a-z]+/((?:0|[1-9][0-9]?)/${INDEX}/${INDEX}/${INDEX})(?:[-/].+)?$`);

/** Names of a world's values in its store (spec/world.md). `cell` is "level/x/y/z". */
export const orthoviewKey = (cell: string, direction: number, layer: number, hash: string): string =>
  `orthoview/${cell}/${direction}/${layer}-${hash}`;
export const indexKey = (cell: string, hash: string): string => `index/${cell}-${hash}`;
export const geometryKey = (cell: string, hash: string): string => `geometry/${cell}-${hash}`;
export const meshKey = (hash: string): string => `mesh/${hash}`;
export const textureKey = (hash: string): string => `texture/${hash}`;

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
