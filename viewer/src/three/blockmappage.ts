import { DataArrayTexture, RGBAIntegerFormat, UnsignedByteType } from "three";
import type { DecodedBlockMap } from "../core/blockmap/decode.js";

/** Bytes that a page has at most: 34 maps of 64:256, 118 of 32:192. */
const PAGE_BYTES = 6 << 20;
/** Layers that every card allows. */
const MOST_LAYERS = 256;

/**
 * Textures of BlockMaps of one size, a layer each: of n rows, side by side the tops, the slopes with floors, the four sides one after the other (n
 * columns each), and the colours (n + m). Only layers that change are uploaded; their copy here outlives a lost context.
 */
export class BlockMapPage {
  readonly texture: DataArrayTexture;
  /** Layers that are not in use; the first comes last. */
  private readonly free: number[];
  private readonly layers: number;
  private readonly width: number;

  constructor(
    /** Texels a side of its maps. */
    readonly n: number,
    /** Columns of their images of walls. */
    readonly m: number,
  ) {
    this.width = 7 * n + m;
    this.layers = layersOf(n, m);
    this.free = Array.from({ length: this.layers }, (_, layer) => this.layers - 1 - layer);
    this.texture = new DataArrayTexture(new Uint8Array(this.layers * this.layerBytes), this.width, n, this.layers);
    this.texture.format = RGBAIntegerFormat;
    this.texture.type = UnsignedByteType;
    this.texture.internalFormat = "RGBA8UI";
  }

  get layerBytes(): number {
    return layerBytes(this.n, this.m);
  }

  /** Maps that it has room for. */
  get capacity(): number {
    return this.layers;
  }

  get isFull(): boolean {
    return this.free.length === 0;
  }

  get isEmpty(): boolean {
    return this.free.length === this.layers;
  }

  /** Takes a map; returns its layer. */
  put({ tops, slopes, floors, sides, colors }: DecodedBlockMap): number {
    const layer = this.free.pop()!;
    const { n, m } = this;
    this.write(layer, 0, n, tops);
    if (slopes || floors) this.write(layer, n, n, together(slopes, floors, n * n));
    for (let side = 0; side < 4; side++) this.write(layer, (2 + side) * n, n, sides.subarray(4 * side * n * n, 4 * (side + 1) * n * n));
    this.write(layer, 6 * n, n + m, colors);
    this.texture.addLayerUpdate(layer);
    this.texture.needsUpdate = true;
    return layer;
  }

  drop(layer: number): void {
    this.free.push(layer);
  }

  dispose(): void {
    this.texture.dispose();
  }

  /** Writes texels of so many columns a row from a column on. */
  private write(layer: number, column: number, columns: number, texels: Uint8Array | Uint8ClampedArray): void {
    const data = this.texture.image.data as Uint8Array;
    for (let row = 0; row < this.n; row++) {
      const to = layer * this.layerBytes + 4 * (row * this.width + column);
      data.set(texels.subarray(4 * row * columns, 4 * (row + 1) * columns), to);
    }
  }
}

function layersOf(n: number, m: number): number {
  return Math.min(MOST_LAYERS, Math.floor(PAGE_BYTES / (4 * n * (7 * n + m))));
}

/** Rise along x and y and the floor of each texel as the first three of four bytes. */
function together(slopes: Int8Array | null, floors: Uint8Array | null, count: number): Uint8Array {
  const texels = new Uint8Array(4 * count);
  for (let at = 0; at < count; at++) {
    texels[4 * at] = slopes?.[2 * at] ?? 0;
    texels[4 * at + 1] = slopes?.[2 * at + 1] ?? 0;
    texels[4 * at + 2] = floors?.[at] ?? 0;
  }
  return texels;
}

/** Bytes of a map of n x n texels and m columns for walls. */
export function layerBytes(n: number, m: number): number {
  return 4 * (7 * n + m) * n;
}
