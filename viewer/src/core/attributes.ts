import { corrupt, FarfieldError } from "./errors.js";
import { isCount, isHash, isObject } from "./limits.js";
import { attributesKey } from "./keys.js";
import { Recent } from "./recent.js";
import type { Servers } from "./servers.js";

/** What an object has of an attribute. */
export type AttributeValue = string | number | boolean;
/** Of an object, by name; what it has no value of is left out. */
export type Attributes = Readonly<Record<string, AttributeValue>>;

const LARGEST_ID = 2 ** 32 - 1;
/** Bytes of text of the tables that are kept, and of an index. */
const KEPT_TABLES = 8 << 20;
const KEPT_INDEX = 1;

/** Objects whose ids follow each other, and the table that has them as its rows. */
interface Part {
  readonly first: number;
  readonly count: number;
  readonly hash: string;
}

/** Columns of a table, all of one length. */
type Table = ReadonlyMap<string, readonly unknown[]>;

/** Reads an index of attributes (spec/world.md, Objects and attributes): ascending parts. Throws `corrupt`. Allocates at most 64 bytes for each of its bytes. */
export function decodeAttributeIndex(bytes: Uint8Array, where: string): readonly Part[] {
  const index = jsonOf(bytes, where);
  const { objects, parts = [] } = isObject(index) ? index : {};
  if (!isCount(objects) || !Array.isArray(parts)) throw damaged(where);
  let free = 1;
  return parts.map((entry: unknown) => {
    const [first, count, hash] = Array.isArray(entry) && entry.length === 3 ? (entry as unknown[]) : [];
    if (!isCount(first, LARGEST_ID) || !isCount(count, LARGEST_ID) || !isHash(hash) || first < free) throw damaged(where);
    free = first + count;
    if (free > LARGEST_ID + 1) throw damaged(where);
    return { first, count, hash };
  });
}

/** Reads a table of attributes. Throws `corrupt`. Allocates at most 64 bytes for each of its bytes. */
export function decodeAttributeTable(bytes: Uint8Array, where: string): Table {
  const table = jsonOf(bytes, where);
  const columns = isObject(table) ? table["columns"] : undefined;
  if (!isObject(columns)) throw damaged(where);
  const found = new Map<string, readonly unknown[]>();
  let rows: number | null = null;
  for (const [name, column] of Object.entries(columns)) {
    if (!Array.isArray(column) || column.length !== (rows ??= column.length)) throw damaged(where);
    found.set(name, column);
  }
  return found;
}

/** The attributes of an object, of tables of which those asked for last are kept. */
export class AttributeTables {
  private readonly indexes = new Recent<readonly Part[]>(KEPT_INDEX);
  private readonly tables = new Recent<Table>(KEPT_TABLES);

  constructor(private readonly servers: Pick<Servers, "of">) {}

  /** What an object has. index: hash of the world's index of attributes; null: it has none. Rejects with `network`, `missing`, `corrupt` or `aborted`. */
  async of(id: number, index: string | null, signal: AbortSignal): Promise<Attributes> {
    const part = index === null ? undefined : partOf(await this.indexOf(index, signal), id);
    if (!part) return {};
    const key = attributesKey(part.hash);
    const table = this.tables.get(key) ?? (await this.read(key, signal, this.tables, decodeAttributeTable));
    return rowOf(table, id - part.first, key);
  }

  private async indexOf(hash: string, signal: AbortSignal): Promise<readonly Part[]> {
    const key = attributesKey(hash);
    return this.indexes.get(key) ?? this.read(key, signal, this.indexes, decodeAttributeIndex);
  }

  private async read<T>(key: string, signal: AbortSignal, kept: Recent<T>, decode: (bytes: Uint8Array, where: string) => T): Promise<T> {
    const bytes = await this.servers.of(key).get(key, signal);
    if (signal.aborted) throw new FarfieldError("aborted", "no longer wanted", key);
    // Two that waited for the same have read it twice.
    return kept.get(key) ?? kept.add(key, decode(bytes, key), bytes.length);
  }
}

function partOf(parts: readonly Part[], id: number): Part | undefined {
  let [from, to] = [0, parts.length];
  while (from < to) {
    const middle = (from + to) >> 1;
    if (parts[middle]!.first <= id) from = middle + 1;
    else to = middle;
  }
  const part = parts[from - 1];
  return part && id < part.first + part.count ? part : undefined;
}

function rowOf(table: Table, row: number, where: string): Attributes {
  const found: [string, AttributeValue][] = [];
  for (const [name, column] of table) {
    const value = column[row];
    if (value === null) continue;
    if (typeof value !== "string" && typeof value !== "number" && typeof value !== "boolean") throw damaged(where);
    found.push([name, value]);
  }
  return Object.fromEntries(found);
}

function jsonOf(bytes: Uint8Array, where: string): unknown {
  try {
    return JSON.parse(new TextDecoder().decode(bytes));
  } catch {
    throw damaged(where);
  }
}

function damaged(where: string): FarfieldError {
  return corrupt("attributes are damaged", where);
}
