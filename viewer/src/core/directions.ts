import type { Vector3 } from "./vector.js";

/** The 26 principal directions of a cube; a direction's number is its place here. */
export const PRINCIPAL: readonly Vector3[] = [-1, 0, 1]
  .flatMap((x) => [-1, 0, 1].flatMap((y) => [-1, 0, 1].map((z): Vector3 => [x, y, z])))
  .filter(([x, y, z]) => x !== 0 || y !== 0 || z !== 0);

/** Image frame of a direction: u to the right, v down, w away from the canonical camera; orthonormal, v = w × u. */
export interface Axes {
  readonly u: Vector3;
  readonly v: Vector3;
  readonly w: Vector3;
}

/** The image frame of unit vector `e`, which points from the surface towards the canonical camera. */
export function axesOf(e: Vector3): Axes {
  const w: Vector3 = [-e[0], -e[1], -e[2]];
  const length = Math.sqrt(e[1] * e[1] + e[0] * e[0]);
  const upright = Math.abs(e[0]) < 1e-9 && Math.abs(e[1]) < 1e-9;
  const u: Vector3 = upright ? [1, 0, 0] : [-e[1] / length, e[0] / length, 0];
  const v: Vector3 = [w[1] * u[2] - w[2] * u[1], w[2] * u[0] - w[0] * u[2], w[0] * u[1] - w[1] * u[0]];
  return { u, v, w };
}

const BINS = PRINCIPAL.map(([x, y, z]): Vector3 => {
  const length = Math.sqrt(x * x + y * y + z * z);
  return [x / length, y / length, z / length];
});

/** Number of the principal direction nearest by angle to the vector middle → eye; ties to the lower number. */
export function viewBin(middle: Vector3, eye: Vector3): number {
  const [x, y, z] = [eye[0] - middle[0], eye[1] - middle[1], eye[2] - middle[2]];
  let best = 0;
  let most = -Infinity;
  BINS.forEach((bin, number) => {
    const cosine = bin[0] * x + bin[1] * y + bin[2] * z;
    if (cosine > most) [most, best] = [cosine, number];
  });
  return best;
}
