import type { Box, Vector3 } from "./vector.js";

/** A half space: inside where normal · point + offset ≥ 0. */
export interface Plane {
  readonly normal: Vector3;
  readonly offset: number;
}

/** The part of the world a picture shows: inside all planes. */
export type Frustum = readonly Plane[];

/** Whether some of a box may be seen (it may err at the corners of the frustum, never the other way). */
export function seesBox(frustum: Frustum, { lower, upper }: Box): boolean {
  return frustum.every(({ normal: [x, y, z], offset }) => {
    const farthest =
      x * (x > 0 ? upper[0] : lower[0]) + y * (y > 0 ? upper[1] : lower[1]) + z * (z > 0 ? upper[2] : lower[2]);
    return farthest + offset >= 0;
  });
}
