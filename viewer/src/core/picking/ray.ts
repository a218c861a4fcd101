import type { Projection } from "../projection.js";
import { cross, dot, type Vector3 } from "../vector.js";

/** Where one looks through a place of a picture. */
export interface Ray {
  /** Local metres. */
  readonly eye: Vector3;
  /** So long that times a distance along the view axis it leads there. */
  readonly direction: Vector3;
}

/** The ray through a place of a picture: pixels from the left and from below. */
export function rayThrough({ eye, toX, toY, toW }: Projection, x: number, y: number): Ray {
  const [acrossX, acrossY, ahead] = [cross(toY, toW), cross(toW, toX), cross(toX, toY)];
  const volume = dot(toX, acrossX);
  const along = (a: 0 | 1 | 2): number => (x * acrossX[a] + y * acrossY[a] + ahead[a]) / volume;
  return { eye, direction: [along(0), along(1), along(2)] };
}

/** The point at a distance along the view axis; `beyond`: metres farther on along the ray. */
export function pointOf({ eye, direction }: Ray, distance: number, beyond = 0): Vector3 {
  const times = distance + (beyond === 0 ? 0 : beyond / Math.hypot(...direction));
  return [eye[0] + times * direction[0], eye[1] + times * direction[1], eye[2] + times * direction[2]];
}
