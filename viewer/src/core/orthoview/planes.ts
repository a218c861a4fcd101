/**
 * Planes of a tile as numbers of its valid pixels, in valid order, whichever codec each is in (spec/orthoview.md, Planes). All throw
 * `corrupt` for anything but what a writer makes.
 */
import { corrupt } from "../errors.js";
import { inflate } from "../inflate.js";
import { unpackBits } from "./bits.js";
import { SymbolReader, type Model } from "./coding.js";
import { BIT_MODELS, COVERAGE_MODELS, DEPTH_MODELS, NORMAL_MODELS, OBJECT_MODELS, type Turns } from "./contexts.js";
import { readBits, readCoverage, readDepth, readMask, readNormals, readObjects } from "./contexts.js";
import { CODEC, PLANE, type StoredPlane, type TileHeader } from "./header.js";
import { MARGIN, validPixels, type ValidPixels } from "./valid.js";

const NAMES: ReadonlyMap<number, string> = new Map(Object.entries(PLANE).map(([name, kind]) => [kind, name]));

export function needPlane(header: TileHeader, kind: number, where: string): StoredPlane {
  const plane = header.planes.get(kind);
  if (!plane) throw corrupt(`tile without ${NAMES.get(kind)}`, where);
  return plane;
}

/** The pixels with a surface, and residuals of depth as zigzag codes. */
export function depthPlane(header: TileHeader, where: string): { pixels: ValidPixels; zigzags: Uint16Array } {
  const { width, height, valid } = header;
  const plane = needPlane(header, PLANE.depth, where);
  const list = (mask: Uint8Array | null): ValidPixels => {
    const pixels = mask && validPixels(mask, width, height, valid);
    if (!pixels) throw corrupt("the mask does not mark the valid pixels", where);
    return pixels;
  };
  if (plane.codec === CODEC.coded) {
    return readWhole(DEPTH_MODELS, plane, where, (reader) => {
      const pixels = list(readMask(reader, width, height));
      return { pixels, zigzags: readDepth(reader, pixels) };
    });
  }
  const maskBytes = (width * height + 7) >> 3;
  const content = contentOf(plane, maskBytes + 2 * valid, where);
  return { pixels: list(plainMask(content.subarray(0, maskBytes), width, height)), zigzags: plainZigzags(content.subarray(maskBytes)) };
}

/** Residuals of the normals; the caller may change them. zigzags: of `depthPlane`. */
export function normalPlane(header: TileHeader, pixels: ValidPixels, zigzags: Uint16Array, where: string): Turns {
  const { valid } = header;
  const plane = needPlane(header, PLANE.normal, where);
  if (plane.codec === CODEC.coded) return readWhole(NORMAL_MODELS, plane, where, (reader) => readNormals(reader, pixels, zigzags));
  const content = contentOf(plane, 2 * valid, where);
  if (content.some((residual) => residual > 63)) throw corrupt("a residual of the normals is beyond 63", where);
  return [content.subarray(0, valid), content.subarray(valid)];
}

/** Coverage - 1 times 8 and length - 1; null where the tile has none. near: of `countNear`. */
export function coveragePlane(header: TileHeader, pixels: ValidPixels, near: Uint8Array, turns: Turns, where: string): Uint8Array | null {
  const plane = header.planes.get(PLANE.coverage);
  if (!plane) return null;
  if (plane.codec === CODEC.coded) return readWhole(COVERAGE_MODELS, plane, where, (reader) => readCoverage(reader, pixels, near, turns));
  const codes = contentOf(plane, header.valid, where);
  if (codes.some((code) => code > 127)) throw corrupt("a coverage byte is beyond 127", where);
  return codes;
}

/** Flags or unlit, 0 or 1; null where the tile has none. near: of `countNear`. */
export function bitPlane(header: TileHeader, kind: number, pixels: ValidPixels, near: Uint8Array, where: string): Uint8Array | null {
  const plane = header.planes.get(kind);
  if (!plane) return null;
  if (plane.codec === CODEC.coded) return readWhole(BIT_MODELS, plane, where, (reader) => readBits(reader, pixels, near));
  const bits = unpackBits(contentOf(plane, (header.valid + 7) >> 3, where), header.valid);
  if (!bits) throw corrupt(`${NAMES.get(kind)} of more than the valid pixels`, where);
  return bits;
}

/** (valid,) object ids. header: of the file that has them. */
export function objectPlane(header: TileHeader, pixels: ValidPixels, where: string): Uint32Array {
  const { valid } = header;
  const plane = needPlane(header, PLANE.objects, where);
  if (plane.codec === CODEC.coded) {
    return readWhole(OBJECT_MODELS, plane, where, (reader) => {
      const ids = readObjects(reader, pixels);
      if (!ids) throw corrupt("object ids name neighbours that are not there", where);
      return ids;
    });
  }
  const content = contentOf(plane, 4 * valid, where);
  const ids = new Uint32Array(valid);
  for (let k = 0, last = 0; k < valid; k++) {
    const step = (content[k]! << 24) | (content[valid + k]! << 16) | (content[2 * valid + k]! << 8) | content[3 * valid + k]!;
    ids[k] = last = (last + step) >>> 0;
  }
  return ids;
}

/** What `read` makes of a coded plane, if it reads all of it. */
function readWhole<T>(models: readonly Model[], plane: StoredPlane, where: string, read: (reader: SymbolReader) => T): T {
  const reader = new SymbolReader(models, plane.bytes, where);
  const numbers = read(reader);
  reader.finish();
  return numbers;
}

/** The bytes of a raw or deflated plane; the caller may change them. */
function contentOf(plane: StoredPlane, length: number, where: string): Uint8Array {
  if (plane.codec === CODEC.deflate) return inflate(plane.bytes, length, where);
  if (plane.bytes.length !== length) throw corrupt(`a plane of ${plane.bytes.length} bytes instead of ${length}`, where);
  return plane.bytes.slice();
}

/** As `readMask` gives it, from bits combined by exclusive or with the one above. Null when bits behind the last are set. */
function plainMask(packed: Uint8Array, width: number, height: number): Uint8Array | null {
  const bits = unpackBits(packed, width * height);
  if (!bits) return null;
  const stride = width + 2 * MARGIN;
  const mask = new Uint8Array((height + MARGIN) * stride);
  for (let row = 0, from = 0; row < height; row++) {
    let at = (row + MARGIN) * stride + MARGIN;
    for (let column = 0; column < width; column++, at++) mask[at] = bits[from++]! ^ mask[at - stride]!;
  }
  return mask;
}

/** High bytes, then low bytes. */
function plainZigzags(bytes: Uint8Array): Uint16Array {
  const count = bytes.length >> 1;
  const zigzags = new Uint16Array(count);
  for (let k = 0; k < count; k++) zigzags[k] = (bytes[k]! << 8) | bytes[count + k]!;
  return zigzags;
}
