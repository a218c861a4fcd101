/** Three numbers: x east, y north, z up, local metres unless said otherwise. */
export type Vector3 = readonly [number, number, number];

/** Lower and upper corner. */
export interface Box {
  readonly lower: Vector3;
  readonly upper: Vector3;
}

export function dot(a: Vector3, b: Vector3): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

export function middleOf({ lower, upper }: Box): Vector3 {
  return [(lower[0] + upper[0]) / 2, (lower[1] + upper[1]) / 2, (lower[2] + upper[2]) / 2];
}

/** Metres from a point to the nearest point of a box; 0 inside. */
export function distanceTo({ lower, upper }: Box, point: Vector3): number {
  const x = Math.max(lower[0] - point[0], point[0] - upper[0], 0);
  const y = Math.max(lower[1] - point[1], point[1] - upper[1], 0);
  const z = Math.max(lower[2] - point[2], point[2] - upper[2], 0);
  return Math.sqrt(x * x + y * y + z * z);
}

/** A box with `margin` more on all sides. */
export function grown({ lower, upper }: Box, margin: number): Box {
  return {
    lower: [lower[0] - margin, lower[1] - margin, lower[2] - margin],
    upper: [upper[0] + margin, upper[1] + margin, upper[2] + margin],
  };
}

export function cross(a: Vector3, b: Vector3): Vector3 {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function distance(a: Vector3, b: Vector3): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

/** Metres from a point to the farthest corner of a box. */
export function farthestIn({ lower, upper }: Box, point: Vector3): number {
  const along = (a: 0 | 1 | 2): number => Math.max(point[a] - lower[a], upper[a] - point[a]);
  return Math.hypot(along(0), along(1), along(2));
}
