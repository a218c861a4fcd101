import { inflateSync } from "fflate";
import { corrupt, FarfieldError } from "./errors.js";

/**
 * Unpacks a deflate stream without header (RFC 1951) that must give exactly `length` bytes, and never allocates more.
 * Throws `corrupt` otherwise. (The browser's own DecompressionStream takes 1 to 4 ms a stream whatever its length, and a
 * tile has four of 1 to 500 kB; this takes 10 ms a megabyte.)
 */
export function inflate(packed: Uint8Array, length: number, where: string): Uint8Array {
  try {
    // One byte more than allowed shows streams that are longer: what is beyond `out` is dropped.
    const result = inflateSync(packed, { out: new Uint8Array(length + 1) });
    if (result.length !== length) throw corrupt(`does not unpack to ${length} bytes`, where);
    return result;
  } catch (error) {
    throw error instanceof FarfieldError ? error : corrupt("cannot be unpacked", where);
  }
}
