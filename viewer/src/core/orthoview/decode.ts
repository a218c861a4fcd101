import { corrupt } from "../errors.js";
import { inflate } from "../inflate.js";
import { PLANE, readTile, type StoredPlane, type TileHeader } from "./header.js";
import { checkWebp } from "./webp.js";
import { restoreDepth, restoreNormals, unzigzag, validPixels, type ValidPixels } from "./predict.js";

/** Words a pixel. */
export const WORDS = 3;

/** One layer of an orthoview, ready for upload. */
export interface DecodedTile {
  readonly direction: number;
  readonly layer: number;
  readonly level: number;
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
  readonly depthBase: number;
  /** Least and greatest depth code. */
  readonly depthRange: readonly [number, number];
  /** Number of pixels. */
  readonly count: number;
  /**
   * (count, 3) the valid pixels, bits from the lowest:
   *
   *     column 12, row 12, depth 8 (low)
   *     red 8, green 8, blue 8, depth 8 (high)
   *     normal 6 + 6, coverage - 1 4, length - 1 3, connected 1, unlit 1
   */
  readonly pixels: Uint32Array;
}

/** Decodes a WebP file into RGBA bytes, width x height x 4. */
export type ColorDecoder = (bytes: Uint8Array, width: number, height: number, where: string) => Promise<Uint8ClampedArray>;

/**
 * Reads an orthoview tile. Throws `corrupt` for anything but a whole one. Allocates at most 64 bytes a pixel of the rectangle, which is at
 * most 4096 x 4096, and what `inflate` takes.
 */
export async function decodeTile(bytes: Uint8Array, where: string, decodeColor: ColorDecoder): Promise<DecodedTile> {
  const header = readTile(bytes, where);
  const color = need(header, PLANE.color, "colour", where);
  checkWebp(color.bytes, header.width, header.height, where);
  const rgba = await decodeColor(color.bytes, header.width, header.height, where);
  const depth = content(need(header, PLANE.depth, "depth", where), maskBytes(header) + 2 * header.valid, where);
  const normal = content(need(header, PLANE.normal, "normal", where), 2 * header.valid, where);
  if (normal.some((residual) => residual > 63)) throw corrupt("a residual of the normals is beyond 63", where);
  const coverage = optional(header, PLANE.coverage, header.valid, where);
  if (coverage?.some((code) => code > 127)) throw corrupt("a coverage byte is beyond 127", where);
  const flags = optional(header, PLANE.flags, (header.valid + 7) >> 3, where);
  const unlit = optional(header, PLANE.unlit, (header.valid + 7) >> 3, where);
  const pixels = validPixels(depth, header.width, header.height, header.valid);
  if (!pixels) throw corrupt("the mask does not mark the valid pixels", where);
  const depths = unzigzag(depth.subarray(maskBytes(header)));
  restoreDepth(depths, pixels);
  const [a, b] = [normal.subarray(0, header.valid), normal.subarray(header.valid)];
  restoreNormals(a, b, depths, pixels);
  const { direction, layer, level, x, y, width, height, depthBase } = header;
  return {
    direction, layer, level, x, y, width, height, depthBase,
    depthRange: rangeOf(depths, where),
    count: header.valid,
    pixels: interleave({ pixels, depths, a, b, coverage, flags, unlit, rgba, width }),
  };
}

interface Planes {
  readonly pixels: ValidPixels;
  readonly depths: Uint16Array;
  readonly a: Uint8Array;
  readonly b: Uint8Array;
  readonly coverage: Uint8Array | null;
  readonly flags: Uint8Array | null;
  readonly unlit: Uint8Array | null;
  readonly rgba: Uint8ClampedArray;
  readonly width: number;
}

function interleave({ pixels, depths, a, b, coverage, flags, unlit, rgba, width }: Planes): Uint32Array {
  const count = depths.length;
  const words = new Uint32Array(count * WORDS);
  const bitOf = (plane: Uint8Array | null, k: number): number => (plane ? (plane[k >> 3]! >> (7 - (k & 7))) & 1 : 0);
  for (let k = 0, at = 0; k < count; k++) {
    const position = pixels.position[k]!;
    const depth = depths[k]!;
    const texel = ((position >> 12) * width + (position & 4095)) * 4;
    const codes = coverage ? coverage[k]! : 127;
    words[at++] = position | ((depth & 255) << 24);
    words[at++] = rgba[texel]! | (rgba[texel + 1]! << 8) | (rgba[texel + 2]! << 16) | ((depth >> 8) << 24);
    words[at++] =
      a[k]! | (b[k]! << 6) | ((codes >> 3) << 12) | ((codes & 7) << 16) | (bitOf(flags, k) << 19) | (bitOf(unlit, k) << 20);
  }
  return words;
}

function rangeOf(depths: Uint16Array, where: string): [number, number] {
  let [least, greatest] = [0xffff, 0];
  for (let k = 0; k < depths.length; k++) {
    const depth = depths[k]!;
    if (depth < least) least = depth;
    if (depth > greatest) greatest = depth;
  }
  if (least === 0) throw corrupt("a valid pixel has depth 0", where);
  return [least, greatest];
}

function maskBytes({ width, height }: TileHeader): number {
  return (width * height + 7) >> 3;
}

function need(header: TileHeader, kind: number, name: string, where: string): StoredPlane {
  const plane = header.planes.get(kind);
  if (!plane) throw corrupt(`tile without ${name}`, where);
  return plane;
}

function optional(header: TileHeader, kind: number, length: number, where: string): Uint8Array | null {
  const plane = header.planes.get(kind);
  return plane ? content(plane, length, where) : null;
}

/** The bytes of a plane; the caller may change them. */
function content(plane: StoredPlane, length: number, where: string): Uint8Array {
  if (plane.deflated) return inflate(plane.bytes, length, where);
  if (plane.bytes.length !== length) throw corrupt(`a plane of ${plane.bytes.length} bytes instead of ${length}`, where);
  return plane.bytes.slice();
}
