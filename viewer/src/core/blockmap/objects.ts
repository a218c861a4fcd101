import { corrupt } from "../errors.js";
import { inflate } from "../inflate.js";
import { checksum, COLUMNS } from "./header.js";

const HEADER_BYTES = 16;
const CRC_AT = 12;
const MAGIC = 0x4f424646; // "FFBO"
const VERSION = 1;

/**
 * (n, n) object ids of the texels of a BlockMap, 0 = none. Throws `corrupt` for anything else. Allocates at most 16 bytes a texel, and
 * what `inflate` takes.
 */
export function decodeBlockMapObjects(bytes: Uint8Array, where: string): Uint32Array {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  const known = bytes.length >= HEADER_BYTES && view.getUint32(0, true) === MAGIC && view.getUint16(4, true) === VERSION;
  if (!known || !COLUMNS.has(view.getUint8(6)) || view.getUint8(7) !== 0) throw corrupt("not the object ids of a BlockMap", where);
  const n = view.getUint8(6);
  const count = view.getUint32(8, true);
  const isSound = checksum(bytes, CRC_AT) === view.getUint32(CRC_AT, true) && count > 0 && count <= n * n;
  if (!isSound) throw corrupt("object ids are damaged", where);
  const content = inflate(bytes.subarray(HEADER_BYTES), 4 * count + 2 * n * n, where);
  const ids = new DataView(content.buffer, content.byteOffset, 4 * count);
  return Uint32Array.from({ length: n * n }, (_, texel) => {
    const which = content[4 * count + texel]! + 256 * content[4 * count + n * n + texel]!;
    if (which >= count) throw corrupt("object ids are damaged", where);
    return ids.getUint32(4 * which, true);
  });
}
