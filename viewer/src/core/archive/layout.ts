import { crc32 } from "../crc32.js";
import { corrupt, FarfieldError } from "../errors.js";
import { inflate } from "../inflate.js";
import { compareRanks, rankOf, type Rank } from "./order.js";

const MAGIC = 0x52414646; // "FFAR"
const VERSION = 1;
const HEADER_BYTES = 44;
const BLOCK_BYTES = 8;
const MAX_DIRECTORY_BYTES = 16 << 20;
/** Bytes of an entry at least: four numbers of one byte each, and the checksum. */
const SMALLEST_ENTRY = 8;
const VARINT_BYTES = 7;

/** A range of bytes of the archive. */
export interface Span {
  readonly offset: number;
  readonly length: number;
  /** CRC-32 of those bytes. */
  readonly checksum: number;
}

export interface Entry {
  readonly rank: Rank;
  readonly span: Span;
}

export interface Header {
  /** The root directory. */
  readonly root: Span;
  /** Bytes of the whole file. */
  readonly length: number;
}

/** Reads the header at the start of an archive. Throws `not-a-world`, `version` or `corrupt`. */
export function decodeHeader(bytes: Uint8Array, where: string): Header {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  if (bytes.length < 4 || view.getUint32(0, true) !== MAGIC) {
    throw new FarfieldError("not-a-world", "not a farfield archive", where, "is this the address of a .farfield file?");
  }
  if (bytes.length < HEADER_BYTES) throw damaged("the archive is cut short", where);
  const version = view.getUint16(4, true);
  if (version > VERSION) {
    const what = `archive of version ${version}, this viewer reads up to ${VERSION}`;
    throw new FarfieldError("version", what, where, "upgrade farfield");
  }
  const sum = view.getUint32(HEADER_BYTES - 4, true);
  if (crc32(bytes.subarray(0, HEADER_BYTES - 4)) !== sum) throw damaged("the header of the archive is altered", where);
  const root = { offset: wide(view, 8), length: view.getUint32(16, true), checksum: view.getUint32(20, true) };
  const length = wide(view, 24);
  if (!Number.isSafeInteger(length) || root.offset < HEADER_BYTES || root.offset + root.length > length) {
    throw damaged("the root directory lies outside of the archive", where);
  }
  return { root, length };
}

/**
 * Reads a directory of an archive of `total` bytes; its length bounds the memory it takes. Throws `corrupt` for anything
 * but one whose keys are in order and whose spans lie in the archive.
 */
export function decodeDirectory(block: Uint8Array, total: number, where: string): Entry[] {
  if (block.length < BLOCK_BYTES) throw damaged("a directory is cut short", where);
  const head = new DataView(block.buffer, block.byteOffset, BLOCK_BYTES);
  const [unpacked, count] = [head.getUint32(0, true), head.getUint32(4, true)];
  if (unpacked > MAX_DIRECTORY_BYTES || count * SMALLEST_ENTRY > unpacked) {
    throw damaged("the size of a directory is absurd", where);
  }
  const columns = new Columns(inflate(block.subarray(BLOCK_BYTES), unpacked, where), where);
  const [shared, rest, gaps, lengths] = [1, 2, 3, 4].map(() => columns.varints(count)) as [number[], number[], number[], number[]];
  const sums = columns.take(4 * count);
  const checksums = new DataView(sums.buffer, sums.byteOffset, sums.length);
  const text = new TextDecoder().decode(columns.take(rest.reduce((sum, length) => sum + length, 0)));
  if (columns.left > 0) throw damaged("bytes follow a directory's end", where);
  const entries: Entry[] = [];
  for (let n = 0, at = 0, key = "", end = 0; n < count; n++) {
    if (shared[n]! > key.length) throw damaged("a key of a directory is cut short", where);
    key = key.slice(0, shared[n]) + text.slice(at, at + rest[n]!);
    at += rest[n]!;
    const offset = end + unzigzag(gaps[n]!);
    end = offset + lengths[n]!;
    if (offset < HEADER_BYTES || end > total) throw damaged("a value lies outside of the archive", where);
    const rank = rankOf(key);
    if (n > 0 && compareRanks(entries[n - 1]!.rank, rank) >= 0) throw damaged("a directory's keys are not in order", where);
    entries.push({ rank, span: { offset, length: lengths[n]!, checksum: checksums.getUint32(4 * n, true) } });
  }
  return entries;
}

/** The error of an archive whose bytes are not those that were written. */
export function damaged(what: string, where: string): FarfieldError {
  return new FarfieldError("corrupt", what, where, "farfield copy the world again");
}

/** Reads numbers from bytes; throws `corrupt` at their end. */
class Columns {
  private at = 0;

  constructor(
    private readonly bytes: Uint8Array,
    private readonly where: string,
  ) {}

  get left(): number {
    return this.bytes.length - this.at;
  }

  take(count: number): Uint8Array {
    if (count > this.left) throw damaged("a directory is cut short", this.where);
    this.at += count;
    return this.bytes.subarray(this.at - count, this.at);
  }

  varints(count: number): number[] {
    return Array.from({ length: count }, () => this.varint());
  }

  private varint(): number {
    let value = 0;
    for (let n = 0; n < VARINT_BYTES; n++) {
      const byte = this.take(1)[0]!;
      value += (byte & 127) * 128 ** n;
      if (byte < 128) return value;
    }
    throw corrupt("a number of a directory is too long", this.where);
  }
}

function unzigzag(value: number): number {
  return value % 2 === 0 ? value / 2 : -(value + 1) / 2;
}

/** Beyond 2^53 it is not exact, and no file is so long. */
function wide(view: DataView, at: number): number {
  return view.getUint32(at, true) + view.getUint32(at + 4, true) * 2 ** 32;
}
