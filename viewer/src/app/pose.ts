import { dot, type Vector3 } from "../core/vector.js";

/** Where the camera is; `fov` is vertical, degrees; local metres. */
export interface Pose {
  readonly eye: Vector3;
  readonly target: Vector3;
  readonly fov: number;
}

export const DEFAULT_FOV = 50;
/** Share of the picture's half that the whole world may take. */
const FRAMED = 0.92;
const STEEPEST = (89.5 * Math.PI) / 180;

/** A pose as angles: how the target lies from the eye. */
export interface Aim {
  /** From north, clockwise, radians. */
  readonly heading: number;
  /** Above the horizon, radians. */
  readonly pitch: number;
  readonly distance: number;
}

export function aimOf({ eye, target }: Pose): Aim {
  const [x, y, z] = [target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]];
  const distance = Math.hypot(x, y, z) || 1;
  const level = Math.hypot(x, y);
  return { heading: level > 1e-9 * distance ? Math.atan2(x, y) : 0, pitch: Math.asin(z / distance), distance };
}

/** From eye to target. */
export function reachOf({ heading, pitch, distance }: Aim): Vector3 {
  const p = Math.max(-STEEPEST, Math.min(STEEPEST, pitch));
  return [
    Math.sin(heading) * Math.cos(p) * distance,
    Math.cos(heading) * Math.cos(p) * distance,
    Math.sin(p) * distance,
  ];
}

export function plus(a: Vector3, b: Vector3, times = 1): Vector3 {
  return [a[0] + b[0] * times, a[1] + b[1] * times, a[2] + b[2] * times];
}

/** Frames a box from the south-west, looking down 25 degrees: as near as all its corners allow. */
export function overview(lower: Vector3, upper: Vector3, aspect: number, fov = DEFAULT_FOV): Pose {
  const target = plus(lower, upper).map((c) => c / 2) as unknown as Vector3;
  const aim: Aim = { heading: Math.PI / 4, pitch: (-25 * Math.PI) / 180, distance: 1 };
  const forward = reachOf(aim);
  const right = reachOf({ ...aim, heading: aim.heading + Math.PI / 2, pitch: 0 });
  const up = reachOf({ ...aim, pitch: aim.pitch + Math.PI / 2 });
  const tangent = Math.tan((fov * Math.PI) / 360) * FRAMED;
  let distance = 1e-3;
  for (let n = 0; n < 8; n++) {
    const corner = lower.map((c, axis) => ((n >> axis) & 1 ? upper[axis]! : c) - target[axis]!) as unknown as Vector3;
    const beyond = dot(corner, forward);
    const across = Math.max(Math.abs(dot(corner, right)) / (tangent * aspect), Math.abs(dot(corner, up)) / tangent);
    distance = Math.max(distance, across - beyond);
  }
  return { eye: plus(target, forward, -distance), target, fov };
}
