import { Matrix4, type Camera, type PerspectiveCamera } from "three";
import { dot, type Box, type Vector3 } from "../core/vector.js";
import type { Frustum } from "../core/frustum.js";
import type { Projection } from "../core/projection.js";

/** A camera as seen from the world's own frame, in double precision. */
export interface Viewpoint extends Projection {
  /** Pixels that a metre takes at distance 1. */
  readonly focal: number;
  readonly frustum: Frustum;
  /** Tangent of half the horizontal field of view. */
  readonly tangent: number;
}

/** The viewpoint of a perspective camera for a world placed by `placement`, drawn `width` x `height` pixels large. */
export function viewpointOf(camera: Camera, placement: Matrix4, width: number, height: number): Viewpoint {
  const viewing = new Matrix4().multiplyMatrices(camera.matrixWorldInverse, placement).elements;
  const row = (n: number): Vector3 => [viewing[n]!, viewing[n + 4]!, viewing[n + 8]!];
  const [right, up, back] = [row(0), row(1), row(2)];
  const forward: Vector3 = [-back[0], -back[1], -back[2]];
  const back4: Vector3 = [viewing[12]!, viewing[13]!, viewing[14]!];
  const square = dot(right, right);
  const eye = [0, 1, 2].map((a) => -(right[a]! * back4[0] + up[a]! * back4[1] + back[a]! * back4[2]) / square);
  const p = camera.projectionMatrix.elements;
  const toX = combine(right, (width / 2) * p[0]!, forward, (width / 2) * (1 - p[8]!));
  const toY = combine(up, (height / 2) * p[5]!, forward, (height / 2) * (1 - p[9]!));
  const at = eye as unknown as Vector3;
  const near = (camera as PerspectiveCamera).near;
  return {
    eye: at, toX, toY, toW: forward, near, width, height,
    focal: (height / 2) * p[5]! * Math.sqrt(square),
    tangent: 1 / p[0]!,
    frustum: frustumOf(at, toX, toY, forward, near, width, height),
  };
}

function combine(a: Vector3, x: number, b: Vector3, y: number): Vector3 {
  return [a[0] * x + b[0] * y, a[1] * x + b[1] * y, a[2] * x + b[2] * y];
}

/** Half spaces of what a viewpoint sees. */
export function frustumOf(
  eye: Vector3, toX: Vector3, toY: Vector3, toW: Vector3, near: number, width: number, height: number,
): Frustum {
  const through = (normal: Vector3, offset = 0) => ({ normal, offset: offset - dot(normal, eye) });
  return [
    through(toX), through(combine(toW, width, toX, -1)),
    through(toY), through(combine(toW, height, toY, -1)),
    through(toW, -near),
  ];
}

/** A box relative to the eye: what single precision can hold. */
export function relativeTo(eye: Vector3, { lower, upper }: Box): { lower: Vector3; size: Vector3 } {
  return {
    lower: [lower[0] - eye[0], lower[1] - eye[1], lower[2] - eye[2]],
    size: [upper[0] - lower[0], upper[1] - lower[1], upper[2] - lower[2]],
  };
}
