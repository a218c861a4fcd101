import {
  BufferGeometry, DataTexture, GLBufferAttribute, RGIntegerFormat, Sphere, UnsignedIntType, type WebGLRenderer,
} from "three";
import type { CullableTile } from "../core/culling.js";
import type { Grid } from "../core/grid.js";
import type { Direction } from "../core/manifest.js";
import { BOX, type Blocks } from "../core/orthoview/blocks.js";
import { WORDS, type DecodedTile } from "../core/orthoview/decode.js";
import { TEXEL_WORDS } from "../core/orthoview/patches.js";
import { along, type Lattice } from "../core/projection.js";
import type { Vector3 } from "../core/vector.js";

const BYTES_A_POINT = WORDS * 4;
const BYTES_A_TEXEL = TEXEL_WORDS * 4;
/** Texels in a row of the texture of a tile's patches; as splat.frag.glsl has it. */
const TEXTURE_WIDTH = 2048;
const BYTES_A_BLOCK = 48;

/** One layer of an orthoview on the graphics card. */
export class OrthoviewTile implements CullableTile {
  readonly geometry = new BufferGeometry();
  /** Pixels of its patches. */
  readonly texels: DataTexture;
  /** Points. */
  readonly count: number;
  /** Lattice column and row of its first pixel. */
  readonly first: readonly [number, number];
  readonly lattice: Lattice;
  readonly blocks: Blocks;
  readonly extent: Float32Array;
  private readonly buffer: WebGLBuffer;

  constructor(
    renderer: WebGLRenderer,
    tile: DecodedTile,
    grid: Grid,
    readonly direction: Direction,
  ) {
    this.count = tile.count;
    this.first = [tile.x, tile.y];
    this.lattice = latticeOf(tile, direction, grid);
    this.blocks = tile.blocks;
    this.extent = extentOf(tile.blocks);
    const gl = renderer.getContext();
    this.buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, tile.pixels, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
    this.geometry.setAttribute("position", new GLBufferAttribute(this.buffer, gl.UNSIGNED_INT, WORDS, 4, tile.count) as never);
    this.texels = textureOf(tile.texels);
    renderer.initTexture(this.texels);
    // three.js sorts by it, and cannot compute it from a buffer that it does not know.
    this.geometry.boundingSphere = new Sphere();
  }

  /** From the eye to the first column and row at depth code 0, in the layer's frame; computed in double precision. */
  originFrom(eye: Vector3): Vector3 {
    const { axes, corner } = this.lattice;
    const from = along(eye, axes);
    return [corner[0] - from[0], corner[1] - from[1], corner[2] - from[2]];
  }

  dispose(renderer: WebGLRenderer): void {
    this.geometry.dispose();
    this.texels.dispose();
    renderer.getContext().deleteBuffer(this.buffer);
  }
}

/** Bytes that a decoded tile takes on the graphics card, and its blocks beside it. */
export function tileBytes(tile: DecodedTile): number {
  return tile.count * BYTES_A_POINT + (tile.texels.length / TEXEL_WORDS) * BYTES_A_TEXEL + tile.blocks.count * BYTES_A_BLOCK;
}

function textureOf(texels: Uint32Array): DataTexture {
  const rows = Math.max(1, Math.ceil(texels.length / TEXEL_WORDS / TEXTURE_WIDTH));
  const width = rows > 1 ? TEXTURE_WIDTH : Math.max(1, texels.length / TEXEL_WORDS);
  const whole = new Uint32Array(rows * width * TEXEL_WORDS);
  whole.set(texels);
  const texture = new DataTexture(whole, width, rows, RGIntegerFormat, UnsignedIntType);
  texture.internalFormat = "RG32UI";
  texture.needsUpdate = true;
  // On the card from then on.
  texture.onUpdate = () => void ((texture.image as { data: unknown }).data = null);
  return texture;
}

function latticeOf(tile: DecodedTile, { axes }: Direction, grid: Grid): Lattice {
  const pitch = grid.pitch(tile.level);
  const zero = along(grid.corner, axes);
  return { axes, pitch, corner: [zero[0] + tile.x * pitch, zero[1] + tile.y * pitch, zero[2] + (tile.depthBase * pitch) / 8] };
}

function extentOf({ boxes }: Blocks): Float32Array {
  const extent = boxes.slice(0, BOX);
  for (let at = BOX; at < boxes.length; at += BOX) {
    for (let a = 0; a < 3; a++) {
      extent[a] = Math.min(extent[a]!, boxes[at + a]!);
      extent[a + 3] = Math.max(extent[a + 3]!, boxes[at + a + 3]!);
    }
  }
  return extent;
}
