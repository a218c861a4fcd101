import { Inflate, inflateSync } from "fflate";
import { corrupt, FarfieldError } from "./errors.js";

/**
 * Bytes that are unpacked at once: at most 1032 times as many come out, 33 MB in half a second, before it is noticed that they
 * are too many. Longer streams go piece by piece, which takes a fifth more time (2 kB at once: three times as much).
 */
const PIECE = 32 << 10;
const NOTHING = new Uint8Array(0);

/**
 * Unpacks a deflate stream without header (RFC 1951) that must give exactly `length` bytes; before its begin it may refer to the
 * dictionary. Allocates those bytes, and at most 128 MiB besides for a moment. Throws `corrupt` otherwise. (The browser's own
 * DecompressionStream takes 1 to 4 ms a stream whatever its length, and a tile has four of 1 to 500 kB; this takes 10 ms a megabyte.)
 */
export function inflate(packed: Uint8Array, length: number, where: string, dictionary: Uint8Array = NOTHING): Uint8Array {
  try {
    return packed.length <= PIECE ? inflateAtOnce(packed, length, where, dictionary) : inflatePieces(packed, length, where, dictionary);
  } catch (error) {
    throw error instanceof FarfieldError ? error : corrupt("cannot be unpacked", where);
  }
}

function inflateAtOnce(packed: Uint8Array, length: number, where: string, dictionary: Uint8Array): Uint8Array {
  // One byte more than allowed shows streams that are longer: what is beyond `out` is unpacked, and dropped.
  const result = inflateSync(packed, { out: new Uint8Array(length + 1), dictionary });
  if (result.length !== length) throw wrong(length, where);
  return result;
}

function inflatePieces(packed: Uint8Array, length: number, where: string, dictionary: Uint8Array): Uint8Array {
  const result = new Uint8Array(length);
  let at = 0;
  const stream = new Inflate({ dictionary }, (piece) => {
    if (piece.length > length - at) throw wrong(length, where);
    result.set(piece, at);
    at += piece.length;
  });
  for (let from = 0; from < packed.length; from += PIECE) {
    stream.push(packed.subarray(from, from + PIECE), from + PIECE >= packed.length);
  }
  if (at !== length) throw wrong(length, where);
  return result;
}

function wrong(length: number, where: string): FarfieldError {
  return corrupt(`does not unpack to ${length} bytes`, where);
}
