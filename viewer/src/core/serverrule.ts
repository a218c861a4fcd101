import { crc32 } from "./crc32.js";
import { FarfieldError } from "./errors.js";
import { formatKey, type Grid } from "./grid.js";
import { cellOf } from "./keys.js";
import { isCount, isList, isObject, MAXIMUM_LEVEL } from "./limits.js";

/** The one rule that version 1 knows. */
const RULE = "cell-crc32";
const MOST_SERVERS = 256;
/** Characters. */
const LONGEST_ADDRESS = 256;

const NAME = /(?!\.)[A-Za-z0-9._~-]{1,200}/.source;
const HOST = /(?:[A-Za-z0-9](?:[A-Za-z0-9.-]*[A-Za-z0-9])?|\[[0-9A-Fa-f:.]+\])/.source;
const ABSOLUTE = new RegExp(`^https?://${HOST}(?::[0-9]{1,5})?/(?:${NAME}/)*$`);
const RELATIVE = new RegExp(`^(?:\\./|(?:\\.\\./)?${NAME}/)$`);

const OF_HASH = /^[a-z]+\/([0-9a-f]{16})$/;

/** Over which servers a world is split, and how (spec/world.md, Servers). */
export interface ServerRule {
  /** Of the cells whose names decide for everything at and below them. */
  readonly level: number;
  /** Where each server has its values: absolute, or relative to the manifest's folder; with a slash at the end. */
  readonly addresses: readonly string[];
}

/** Throws `version` for a rule of later versions, and an Error for anything that is no rule. */
export function readServers(value: unknown, where: string): ServerRule {
  if (!isObject(value)) throw new Error("servers");
  const { rule, level, addresses } = value;
  if (typeof rule === "string" && rule !== RULE) {
    const what = `the world is split over servers by the rule "${rule.slice(0, 80)}", this viewer knows "${RULE}" only`;
    throw new FarfieldError("version", what, where, "upgrade farfield");
  }
  if (rule !== RULE || !isCount(level, MAXIMUM_LEVEL)) throw new Error("servers");
  if (!isList(addresses, isAddress, MOST_SERVERS) || addresses.length === 0) throw new Error("addresses of servers");
  if (new Set(addresses).size !== addresses.length) throw new Error("an address of a server is there twice");
  return { level, addresses };
}

/**
 * Whether `value` may be the address of a server: http or https without user, query and fragment; or relative: the
 * manifest's folder itself, one in it, or one beside it.
 */
export function isAddress(value: unknown): value is string {
  return typeof value === "string" && value.length <= LONGEST_ADDRESS && (ABSOLUTE.test(value) || RELATIVE.test(value));
}

/** Number of the server that has a key, from 0; null: it is where the manifest is. */
export function serverOf(key: string, { level, addresses }: ServerRule, grid: Grid): number | null {
  const place = placeOf(key, level, grid);
  return place === null ? null : crc32(new TextEncoder().encode(place)) % addresses.length;
}

/** What decides about a key: the name of a cell, or a hash; null for what is everywhere. */
function placeOf(key: string, level: number, grid: Grid): string | null {
  const hash = OF_HASH.exec(key)?.[1];
  if (hash !== undefined) return hash;
  const cell = cellOf(key);
  return cell && cell.level <= level ? formatKey(grid.ancestor(cell, level)) : null;
}
