import { crc32 } from "./crc32.js";
import { corrupt } from "./errors.js";
import { inflate } from "./inflate.js";
import type { Vector3 } from "./vector.js";

const HEADER_BYTES = 16;
const MAGIC = 0x58494646; // "FFIX"
const MAXIMUM_BYTES = 64 << 20;

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
  readonly children?: readonly string[];
  readonly index?: string;
  readonly geometry?: GeometryEntry | null;
}

/** Reads an index tile. Throws `corrupt` for anything else. */
export function decodeIndexTile(bytes: Uint8Array, where: string): readonly CellEntry[] {
  if (bytes.length < HEADER_BYTES) throw corrupt("index tile is cut short", where);
  const header = new DataView(bytes.buffer, bytes.byteOffset, HEADER_BYTES);
  const length = header.getUint32(8, true);
  if (header.getUint32(0, true) !== MAGIC || header.getUint16(4, true) !== 1 || length > MAXIMUM_BYTES) {
    throw corrupt("not an index tile of a known version", where);
  }
  const text = inflate(bytes.subarray(HEADER_BYTES), length, where);
  if (crc32(text) !== header.getUint32(12, true)) throw corrupt("index tile is damaged", where);
  const { cells } = JSON.parse(new TextDecoder().decode(text)) as { cells?: CellEntry[] };
  if (!Array.isArray(cells)) throw corrupt("index tile without cells", where);
  return cells;
}
