import type { Axes } from "./directions.js";
import { dot, type Vector3 } from "./vector.js";

/** How a camera maps the world's own frame to a picture, in double precision. */
export interface Projection {
  /** Local metres. */
  readonly eye: Vector3;
  /** Rows that give screen position and distance along the view axis: x = (toX · c) / (toW · c), pixels from the left. */
  readonly toX: Vector3;
  /** Pixels from below. */
  readonly toY: Vector3;
  readonly toW: Vector3;
  readonly near: number;
  /** Size of the picture, pixels. */
  readonly width: number;
  readonly height: number;
}

/** Whether two projections are of the same picture. */
export function sameProjection(a: Projection, b: Projection): boolean {
  const numbersOf = ({ eye, toX, toY, toW, near, width, height }: Projection): number[] => [...eye, ...toX, ...toY, ...toW, near, width, height];
  const others = numbersOf(b);
  return numbersOf(a).every((number, n) => number === others[n]);
}

/** Where the lattice of an orthoview lies: its axes, the first column and row at depth code 0 along them, and its pitch, metres. */
export interface Lattice {
  readonly axes: Axes;
  readonly corner: Vector3;
  readonly pitch: number;
}

/** A vector's parts along three axes. */
export function along(c: Vector3, { u, v, w }: Axes): Vector3 {
  return [dot(c, u), dot(c, v), dot(c, w)];
}

/** A lattice in a picture: a projection whose points are counted in pitches from the lattice's corner, along its axes. */
export class LatticeView {
  /** Where the eye is. */
  readonly eye: Vector3;
  readonly toX: Vector3;
  readonly toY: Vector3;
  readonly toW: Vector3;
  /** Left, right, lower and upper side of the picture and its near plane: (5, 4) normal and offset, inside ≥ 0. */
  private readonly planes: Float64Array;

  constructor(
    readonly view: Projection,
    { axes, corner, pitch }: Lattice,
  ) {
    const from = along(view.eye, axes);
    this.eye = [(from[0] - corner[0]) / pitch, (from[1] - corner[1]) / pitch, (from[2] - corner[2]) / pitch];
    const row = (c: Vector3): Vector3 => {
      const [u, v, w] = along(c, axes);
      return [u * pitch, v * pitch, w * pitch];
    };
    this.toX = row(view.toX);
    this.toY = row(view.toY);
    this.toW = row(view.toW);
    this.planes = planesOf(this);
  }

  /** Whether some of the box at `boxes[at]` (lower, upper) may be in the picture. */
  sees(boxes: Float32Array, at: number): boolean {
    const { planes } = this;
    for (let n = 0; n < planes.length; n += 4) {
      let farthest = planes[n + 3]!;
      for (let a = 0; a < 3; a++) farthest += planes[n + a]! * boxes[at + a + (planes[n + a]! > 0 ? 3 : 0)]!;
      if (farthest < 0) return false;
    }
    return true;
  }
}

function planesOf({ view, eye, toX, toY, toW }: LatticeView): Float64Array {
  const { width, height, near } = view;
  const less = (size: number, row: Vector3): Vector3 => [size * toW[0] - row[0], size * toW[1] - row[1], size * toW[2] - row[2]];
  const planes = new Float64Array(20);
  [toX, less(width, toX), toY, less(height, toY), toW].forEach((normal, n) => {
    planes.set(normal, 4 * n);
    planes[4 * n + 3] = -dot(normal, eye) - (n === 4 ? near : 0);
  });
  return planes;
}
