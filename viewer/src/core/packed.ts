import { crc32 } from "./crc32.js";
import { corrupt } from "./errors.js";
import { inflate } from "./inflate.js";

const HEADER_BYTES = 16;
/** Versions, and a reserved zero. */
const [PLAIN, WITH_DICTIONARY] = [1, 2];

/** What a packed value says of itself. */
export interface PackedKind {
  readonly magic: number;
  /** Bytes that it never unpacks to more than. */
  readonly largest: number;
  readonly name: string;
  /** Of version 2; kinds without one have no such version. */
  readonly dictionary?: Uint8Array;
}

/** Whether bytes begin as a packed value of that kind. */
export function isPacked(bytes: Uint8Array, { magic }: PackedKind): boolean {
  return bytes.length >= 4 && new DataView(bytes.buffer, bytes.byteOffset, 4).getUint32(0, true) === magic;
}

/**
 * The content of a value that is deflated behind a head of 16 bytes (spec/world.md, Packed values). Allocates no more than the head
 * declares, and what `inflate` takes. Throws `corrupt`.
 */
export function unpack(bytes: Uint8Array, kind: PackedKind, where: string): Uint8Array {
  if (bytes.length < HEADER_BYTES) throw corrupt(`${kind.name} is cut short`, where);
  const header = new DataView(bytes.buffer, bytes.byteOffset, HEADER_BYTES);
  const [version, length] = [header.getUint32(4, true), header.getUint32(8, true)];
  const dictionary = version === WITH_DICTIONARY ? kind.dictionary : undefined;
  if (header.getUint32(0, true) !== kind.magic || (version !== PLAIN && !dictionary) || length > kind.largest) {
    throw corrupt(`not ${kind.name} of a known version`, where);
  }
  const content = inflate(bytes.subarray(HEADER_BYTES), length, where, dictionary);
  if (crc32(content) !== header.getUint32(12, true)) throw corrupt(`${kind.name} is damaged`, where);
  return content;
}
