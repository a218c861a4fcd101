import { corrupt } from "../errors.js";

const FRAME_AT = 20;
const [RIFF, WEBP, VP8] = [0x46464952, 0x50424557, 0x20385056];

/**
 * Checks that a file is a simple lossy WebP (RFC 9649) of that size, before a decoder sees it: a decoder would allocate
 * whatever the file claims. Throws `corrupt` otherwise.
 */
export function checkWebp(bytes: Uint8Array, width: number, height: number, where: string): void {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  const simple =
    bytes.length >= FRAME_AT + 10 &&
    view.getUint32(0, true) === RIFF &&
    view.getUint32(8, true) === WEBP &&
    view.getUint32(12, true) === VP8 &&
    view.getUint32(4, true) + 8 === bytes.length &&
    // Nothing but this one chunk, padded to an even length.
    view.getUint32(4, true) === view.getUint32(16, true) + (view.getUint32(16, true) & 1) + 12 &&
    bytes[FRAME_AT + 3] === 0x9d && bytes[FRAME_AT + 4] === 0x01 && bytes[FRAME_AT + 5] === 0x2a;
  if (!simple) throw corrupt("the colour is no simple lossy WebP", where);
  const [columns, rows] = [view.getUint16(26, true) & 0x3fff, view.getUint16(28, true) & 0x3fff];
  if (columns !== width || rows !== height) {
    throw corrupt(`the colour is ${columns} x ${rows} instead of ${width} x ${height}`, where);
  }
}
