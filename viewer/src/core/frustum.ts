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

/** A box along three orthonormal axes. */
export interface OrientedBox {
  readonly middle: Vector3;
  readonly axes: readonly [Vector3, Vector3, Vector3];
  /** Half its edges along the axes. */
  readonly half: Vector3;
}

/** Whether some of an oriented box may be seen. */
export function seesOrientedBox(frustum: Frustum, { middle, axes, half }: OrientedBox): boolean {
  return frustum.every(({ normal, offset }) => {
    let reach = offset;
    for (let a = 0; a < 3; a++) {
      const axis = axes[a]!;
      reach += normal[a]! * middle[a]!;
      reach += half[a]! * Math.abs(normal[0] * axis[0] + normal[1] * axis[1] + normal[2] * axis[2]);
    }
    return reach >= 0;
  });
}
