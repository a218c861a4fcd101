import { DataArrayTexture, RGBAIntegerFormat, UnsignedByteType } from "three";
import type { DecodedBlockMap } from "../core/blockmap/decode.js";

/** Bytes that a page has at most: 34 maps of 64:256, 118 of 32:192. */
const PAGE_BYTES = 6 << 20;
/** Layers that every card allows. */
const MOST_LAYERS = 256;

/**
 * Textures of BlockMaps of one size, a layer each: of n rows, side by side the tops, the slopes with floors, the four sides one after the other (n
 * columns each), and the colours (n + m). Only layers that change are uploaded; their copy here outlives a lost context. A page that is full
 * has twice the layers from then on, until it is as large as it may be.
 */
export class BlockMapPage {
  readonly texture: DataArrayTexture;
  /** Maps that it may have at most. */
  readonly capacity: number;
  /** Layers that are in use. */
  private readonly used = new Set<number>();
  private readonly width: number;

  constructor(
    /** Texels a side of its maps. */
    readonly n: number,
    /** Columns of their images of walls. */
    readonly m: number,
  ) {
    this.width = 7 * n + m;
    this.capacity = layersOf(n, m);
    this.texture = new DataArrayTexture(new Uint8Array(this.layerBytes), this.width, n, 1);
    this.texture.format = RGBAIntegerFormat;
    this.texture.type = UnsignedByteType;
    this.texture.internalFormat = "RGBA8UI";
  }

  get layerBytes(): number {
    return layerBytes(this.n, this.m);
  }

  /** Of the graphics card, and as many here. */
  get bytes(): number {
    return this.layers * this.layerBytes;
  }

  get isFull(): boolean {
    return this.used.size === this.capacity;
  }

  get isEmpty(): boolean {
    return this.used.size === 0;
  }

  /** Takes a map; returns its layer. */
  put({ tops, slopes, floors, sides, colors }: DecodedBlockMap): number {
    const layer = this.freeLayer();
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
    this.used.delete(layer);
  }

  dispose(): void {
    this.texture.dispose();
  }

  private get layers(): number {
    return this.texture.image.depth;
  }

  /** The first that is not in use, which it is from now on. */
  private freeLayer(): number {
    if (this.used.size === this.layers) this.grow();
    let layer = 0;
    while (this.used.has(layer)) layer++;
    this.used.add(layer);
    return layer;
  }

  private grow(): void {
    const { width, n, texture } = this;
    const depth = Math.min(2 * this.layers, this.capacity);
    const data = new Uint8Array(depth * this.layerBytes);
    data.set(texture.image.data as Uint8Array);
    // A texture on the card keeps its size: it is made anew, with all that was in it.
    texture.dispose();
    texture.image = { data, width, height: n, depth };
    for (const layer of this.used) texture.addLayerUpdate(layer);
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
