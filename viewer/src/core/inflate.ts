import { corrupt } from "./errors.js";

/**
 * Unpacks a deflate stream without header (RFC 1951) that must give exactly `length` bytes.
 * Never holds more than `length` bytes and one chunk. Throws `corrupt` otherwise.
 */
export async function inflate(packed: Uint8Array, length: number, where: string): Promise<Uint8Array> {
  const result = new Uint8Array(length);
  const reader = new Blob([packed as BlobPart]).stream().pipeThrough(new DecompressionStream("deflate-raw")).getReader();
  let at = 0;
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) break;
      if (at + value.length > length) throw corrupt(`unpacks to more than ${length} bytes`, where);
      result.set(value, at);
      at += value.length;
    }
  } catch (error) {
    await reader.cancel().catch(() => undefined);
    throw error instanceof Error && error.name === "FarfieldError" ? error : corrupt("cannot be unpacked", where);
  }
  if (at !== length) throw corrupt(`unpacks to ${at} bytes instead of ${length}`, where);
  return result;
}
