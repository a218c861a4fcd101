import { BufferGeometry, GLBufferAttribute, Sphere, type WebGLRenderer } from "three";
import type { OrientedBox } from "../core/frustum.js";
import type { Grid } from "../core/grid.js";
import type { Direction } from "../core/manifest.js";
import { WORDS, type DecodedTile } from "../core/orthoview/decode.js";
import type { Vector3 } from "../core/vector.js";

const BYTES_A_PIXEL = WORDS * 4;
/** Pitches that a splat reaches beyond its middle, at most, along an axis. */
const MARGIN = 4;

/** One layer of an orthoview on the graphics card. */
export class OrthoviewTile {
  readonly geometry = new BufferGeometry();
  readonly count: number;
  readonly pitch: number;
  readonly lattice: readonly [number, number];
  /** Where its surfaces lie, local metres, with room for the footprints. */
  readonly box: OrientedBox;
  private readonly corner: Vector3;
  private readonly buffer: WebGLBuffer;

  constructor(
    renderer: WebGLRenderer,
    tile: DecodedTile,
    grid: Grid,
    readonly direction: Direction,
  ) {
    this.count = tile.count;
    this.pitch = grid.pitch(tile.level);
    this.lattice = [tile.x, tile.y];
    const step = this.pitch / 8;
    const { u, v, w } = direction.axes;
    const zero = along(grid.corner, u, v, w);
    this.corner = [zero[0] + tile.x * this.pitch, zero[1] + tile.y * this.pitch, zero[2] + tile.depthBase * step];
    this.box = boxOf(tile, direction, this.corner, this.pitch);
    const gl = renderer.getContext();
    this.buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.bufferData(gl.ARRAY_BUFFER, tile.pixels, gl.STATIC_DRAW);
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
    this.geometry.setAttribute("position", new GLBufferAttribute(this.buffer, gl.UNSIGNED_INT, WORDS, 4, tile.count) as never);
    // three.js sorts by it, and cannot compute it from a buffer that it does not know.
    this.geometry.boundingSphere = new Sphere();
  }

  /** From the eye to the first column and row at depth code 0, in the layer's frame; computed in double precision. */
  originFrom(eye: Vector3): Vector3 {
    const { u, v, w } = this.direction.axes;
    const from = along(eye, u, v, w);
    return [this.corner[0] - from[0], this.corner[1] - from[1], this.corner[2] - from[2]];
  }

  dispose(renderer: WebGLRenderer): void {
    this.geometry.dispose();
    renderer.getContext().deleteBuffer(this.buffer);
  }
}

/** Bytes that a decoded tile takes on the graphics card. */
export function tileBytes(tile: DecodedTile): number {
  return tile.count * BYTES_A_PIXEL;
}

function boxOf(tile: DecodedTile, { axes: { u, v, w } }: Direction, corner: Vector3, pitch: number): OrientedBox {
  const [least, greatest] = tile.depthRange;
  const half: Vector3 = [
    (tile.width / 2 + MARGIN) * pitch,
    (tile.height / 2 + MARGIN) * pitch,
    ((greatest - least) / 16 + MARGIN) * pitch,
  ];
  const at: Vector3 = [
    corner[0] + (tile.width / 2) * pitch,
    corner[1] + (tile.height / 2) * pitch,
    corner[2] + ((least + greatest) / 16) * pitch,
  ];
  const point = (a: 0 | 1 | 2): number => u[a] * at[0] + v[a] * at[1] + w[a] * at[2];
  return { middle: [point(0), point(1), point(2)], axes: [u, v, w], half };
}

/** A vector's parts along three axes. */
export function along(c: Vector3, u: Vector3, v: Vector3, w: Vector3): Vector3 {
  return [
    c[0] * u[0] + c[1] * u[1] + c[2] * u[2],
    c[0] * v[0] + c[1] * v[1] + c[2] * v[2],
    c[0] * w[0] + c[1] * w[1] + c[2] * w[2],
  ];
}
