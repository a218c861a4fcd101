import { crc32 } from "../crc32.js";
import { corrupt } from "../errors.js";

const HEADER_BYTES = 40;
const CRC_AT = 36;
const MAGIC = 0x4d424646; // "FFBM"
const VERSION = 1;
const [BY_AREA, SLOPED, FLOORED] = [1, 2, 4];
/** Columns of the image of walls, by texels a side. */
export const COLUMNS: ReadonlyMap<number, number> = new Map([[16, 64], [32, 192], [64, 256]]);
const DENSITIES = 8;
const LARGEST_STEP = 1e9;

/** What a BlockMap says of itself (spec/blockmap.md). */
export interface BlockMapHeader {
  /** Texels a side. */
  readonly n: number;
  /** Columns of the image of walls. */
  readonly m: number;
  /** Walls have texels by their area; else a column for each texel. */
  readonly byArea: boolean;
  /** What stands in texels may end above the lowest code. */
  readonly floored: boolean;
  readonly density: number;
  /** Steps of height that a wall has at least. */
  readonly least: number;
  /** Rows of the image of walls for 256 steps. */
  readonly scale: number;
  /** Metres of code 1. */
  readonly low: number;
  /** Metres from code to code. */
  readonly step: number;
  /** As they are stored. */
  readonly heights: Uint8Array;
  /** Null: all tops are flat. */
  readonly slopes: Uint8Array | null;
  readonly turns: Uint8Array;
  readonly colors: Uint8Array;
}

/** Reads the header and finds the streams. Throws `corrupt` unless the value is whole and what it says can be. */
export function readBlockMap(bytes: Uint8Array, where: string): BlockMapHeader {
  if (bytes.length < HEADER_BYTES) throw corrupt("BlockMap is cut short", where);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  if (view.getUint32(0, true) !== MAGIC || view.getUint16(4, true) !== VERSION || view.getUint16(14, true) !== 0) {
    throw corrupt("not a BlockMap of a known version", where);
  }
  if (checksum(bytes, CRC_AT) !== view.getUint32(CRC_AT, true)) throw corrupt("BlockMap is damaged", where);
  const flags = view.getUint8(7);
  const header = {
    n: view.getUint8(6),
    m: view.getUint16(8, true),
    byArea: (flags & BY_AREA) !== 0,
    floored: (flags & FLOORED) !== 0,
    density: view.getUint8(10),
    least: view.getUint8(11),
    scale: view.getUint16(12, true),
    low: view.getFloat32(16, true),
    step: view.getFloat32(20, true),
  };
  const { n, m, density, least, scale, low, step } = header;
  const sane = COLUMNS.get(n) === m && flags <= (BY_AREA | SLOPED | FLOORED) && density < DENSITIES && least > 0 && scale > 0;
  if (!sane || !Number.isFinite(low) || !(step > 0 && step < LARGEST_STEP)) throw corrupt("BlockMap tells what cannot be", where);
  return { ...header, ...streamsOf(bytes, view, (flags & SLOPED) !== 0, where) };
}

/** CRC-32 of a value with 0 in the four bytes of its own, at `at`. */
export function checksum(bytes: Uint8Array, at: number): number {
  return crc32(bytes.subarray(at + 4), crc32(new Uint8Array(4), crc32(bytes.subarray(0, at))));
}

function streamsOf(bytes: Uint8Array, view: DataView, sloped: boolean, where: string) {
  const lengths = [24, 28, 32].map((at) => view.getUint32(at, true)) as [number, number, number];
  const [heights, slopes, turns] = lengths;
  if (HEADER_BYTES + heights + slopes + turns > bytes.length || (slopes > 0) !== sloped) throw corrupt("BlockMap tells what cannot be", where);
  const first = HEADER_BYTES + heights;
  return {
    heights: bytes.subarray(HEADER_BYTES, first),
    slopes: sloped ? bytes.subarray(first, first + slopes) : null,
    turns: bytes.subarray(first + slopes, first + slopes + turns),
    colors: bytes.subarray(first + slopes + turns),
  };
}
