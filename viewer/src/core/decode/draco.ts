/** Vertices, or triangles, for each byte of compressed data: what packs more tightly is no mesh. */
const MOST_ROWS = 16;
const MAGIC = [0x44, 0x52, 0x41, 0x43, 0x4f];
const [HEADER_BYTES, EDGEBREAKER] = [11, 1];

/**
 * Whether compressed triangles (Draco 2.2) claim as many as they are to be, so that nobody allocates for more than the data can
 * hold. Only their head is read.
 */
export function claims(data: Uint8Array, vertices: number, triangles: number): boolean {
  if (data.length < HEADER_BYTES + 3 || MAGIC.some((byte, n) => data[n] !== byte)) return false;
  if (data[5] !== 2 || data[6] !== 2 || data[7] !== 1) return false;
  const byEdges = data[8] === EDGEBREAKER;
  const first = varint(data, byEdges ? HEADER_BYTES + 1 : HEADER_BYTES);
  const second = first && varint(data, first.end);
  if (!first || !second) return false;
  const [points, faces] = byEdges ? [first.number, second.number] : [second.number, first.number];
  return faces === triangles && points <= vertices && Math.max(vertices, triangles) <= MOST_ROWS * data.length;
}

/** A number in groups of seven bits, lowest first. */
function varint(data: Uint8Array, at: number): { readonly number: number; readonly end: number } | null {
  let number = 0;
  for (let place = 0; place < 5; place++) {
    const part = data[at + place];
    if (part === undefined) return null;
    number += (part & 0x7f) * 2 ** (7 * place);
    if (part < 0x80) return { number, end: at + place + 1 };
  }
  return null;
}
