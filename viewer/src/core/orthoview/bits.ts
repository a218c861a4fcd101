/**
 * The bits of a plane or table, most significant first, as (count,) bytes 0 or 1. Null unless there are exactly as many bytes as
 * `count` bits take, and the unused last bits are 0.
 */
export function unpackBits(packed: Uint8Array, count: number): Uint8Array | null {
  const unused = packed.length * 8 - count;
  if (unused < 0 || unused > 7 || (unused > 0 && (packed[packed.length - 1]! & ((1 << unused) - 1)) !== 0)) return null;
  const bits = new Uint8Array(count);
  for (let n = 0; n < count; n++) bits[n] = (packed[n >> 3]! >> (7 - (n & 7))) & 1;
  return bits;
}
