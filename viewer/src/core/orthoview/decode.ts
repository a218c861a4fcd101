import { corrupt } from "../errors.js";
import { orderInBlocks, type Blocks } from "./blocks.js";
import { PLANE, readTile } from "./header.js";
import { coveragePlane, depthPlane, bitPlane, needPlane, normalPlane } from "./planes.js";
import { restoreDepth, restoreNormals, unzigzag } from "./predict.js";
import { countNear, type ValidPixels } from "./valid.js";
import { checkWebp } from "./webp.js";
import { WORDS } from "./words.js";

export { WORDS };

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
   * (count, 3) the valid pixels in order of `blocks`, bits from the lowest:
   *
   *     column 12, row 12, depth 8 (low)
   *     red 8, green 8, blue 8, depth 8 (high)
   *     normal 6 + 6, coverage - 1 4, length - 1 3, connected 1, unlit 1
   */
  readonly pixels: Uint32Array;
  /** (texels, 2) what patches look up (patches.ts); nothing of a tile as it comes. */
  readonly texels: Uint32Array;
  readonly blocks: Blocks;
}

/** Decodes a WebP file into RGBA bytes, width x height x 4, from a multiple of four of their buffer on. */
export type ColorDecoder = (bytes: Uint8Array, width: number, height: number, where: string) => Promise<Uint8ClampedArray>;

/**
 * Reads an orthoview tile. Throws `corrupt` for anything but a whole one. Allocates at most 96 bytes a pixel of the rectangle, which is at
 * most 4096 x 4096, 1 MB for tables, and what `inflate` takes.
 */
export async function decodeTile(bytes: Uint8Array, where: string, decodeColor: ColorDecoder): Promise<DecodedTile> {
  const header = readTile(bytes, where);
  const color = needPlane(header, PLANE.color, where).bytes;
  checkWebp(color, header.width, header.height, where);
  const rgba = await decodeColor(color, header.width, header.height, where);
  const { pixels, zigzags } = depthPlane(header, where);
  const depths = unzigzag(zigzags);
  restoreDepth(depths, pixels);
  const depthRange = rangeOf(depths, where);
  const near = countNear(depths, pixels);
  const [a, b] = normalPlane(header, pixels, zigzags, where);
  const coverage = coveragePlane(header, pixels, near, [a, b], where);
  const flags = bitPlane(header, PLANE.flags, pixels, near, where);
  const unlit = bitPlane(header, PLANE.unlit, pixels, near, where);
  // Last, and in place: contexts of coverage are of the residuals.
  restoreNormals(a, b, depths, pixels);
  const { direction, layer, level, x, y, width, height, depthBase } = header;
  return {
    direction, layer, level, x, y, width, height, depthBase,
    depthRange,
    count: header.valid,
    texels: new Uint32Array(0),
    ...orderInBlocks(interleave({ pixels, depths, a, b, coverage, flags, unlit, rgba, width }), width),
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
  const texels = new Uint32Array(rgba.buffer, rgba.byteOffset, rgba.length >> 2);
  for (let k = 0, at = 0; k < count; k++) {
    const position = pixels.position[k]!;
    const depth = depths[k]!;
    const texel = texels[(position >> 12) * width + (position & 4095)]!;
    const codes = coverage ? coverage[k]! : 127;
    words[at++] = position | ((depth & 255) << 24);
    words[at++] = (texel & 0xffffff) | ((depth >> 8) << 24);
    words[at++] =
      a[k]! | (b[k]! << 6) | ((codes >> 3) << 12) | ((codes & 7) << 16) | ((flags ? flags[k]! : 0) << 19) | ((unlit ? unlit[k]! : 0) << 20);
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
