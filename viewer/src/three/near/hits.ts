import { Matrix4, type BufferAttribute, type BufferGeometry } from "three";
import type { CellGeometry } from "../../core/cell.js";
import type { Grid } from "../../core/grid.js";
import type { Plan } from "../../core/plan.js";
import type { Ray } from "../../core/picking/ray.js";
import { cross, distanceTo, dot, type Vector3 } from "../../core/vector.js";
import { featureOf } from "./features.js";
import type { NearModel } from "./model.js";

/** Share of a distance by which a picture's depth may be beside a triangle: at a grazing angle a corner is moved by parts of a pixel when it is drawn. */
const TOLERANCE = 1e-3;
/** Barycentric: triangles that share an edge leave no gap. */
const EDGE = 1e-6;

/** A triangle on a ray. */
export interface GeometryHit {
  /** Lower corner of the leaf that it is of, local metres. */
  readonly corner: Vector3;
  /** Object id; 0: none. */
  readonly id: number;
}

/** A model as it stands somewhere. */
interface Standing {
  readonly model: NearModel;
  /** The frame that `transform` leads to, local metres; of the leaf that it belongs to. */
  readonly corner: Vector3;
  /** Columns first; null: none. */
  readonly transform: Float32Array | null;
  /** Id of the model's object 0, of an instance. */
  readonly first: number;
}

/**
 * What of the geometry that a plan draws, leaves and what is placed in them or by itself, a ray meets nearest to a distance along the view axis: what stands
 * before it has holes there. Null: nothing about there. Every triangle is tried of models whose box is met there.
 */
export function geometryHit(plan: Plan, grid: Grid, ray: Ray, distance: number): GeometryHit | null {
  let [hit, least]: [GeometryHit | null, number] = [null, TOLERANCE * distance];
  for (const { model, corner, transform, first } of standingAt(plan, grid, ray, distance)) {
    const own = rayFrom(ray, corner, transform);
    if (!own) continue;
    for (const { geometry, features } of model.parts) {
      if (!meets(geometry, own, distance)) continue;
      const { triangle, away } = nearestTriangle(geometry, own, distance);
      if (away >= least) continue;
      const feature = featureOf(features, triangle);
      const id = model.objects ? model.objects[feature]! : first + feature;
      [hit, least] = [{ corner, id }, away];
    }
  }
  return hit;
}

function* standingAt({ geometry, instances }: Plan, { leafSize }: Grid, { eye, direction }: Ray, distance: number): Generator<Standing> {
  const [x, y, z] = [0, 1, 2].map((a) => eye[a]! + distance * direction[a]!) as [number, number, number];
  const margin = TOLERANCE * (distance * Math.hypot(...direction) + leafSize);
  for (const form of geometry) if (distanceTo(form.leaf.cell!.box, [x, y, z]) <= margin) yield* standingIn(form);
  for (const { placed: { bounds, corner, instances: all }, form } of instances) {
    if (!form.mesh.held || distanceTo(bounds, [x, y, z]) > margin) continue;
    const model = form.mesh.payload as NearModel;
    for (const { object, transform } of all) yield { model, corner, transform, first: object };
  }
}

function* standingIn({ leaf, meshes }: CellGeometry): Generator<Standing> {
  if (!leaf.held) return;
  const model = leaf.payload as NearModel;
  const corner = leaf.cell!.box.lower;
  yield { model, corner, transform: null, first: 0 };
  const shared = new Map(meshes.filter(({ held }) => held).map(({ key, payload }) => [key.slice(key.indexOf("/") + 1), payload as NearModel]));
  for (const { mesh, transforms, objects } of model.placements) {
    const placed = shared.get(mesh);
    if (!placed) continue;
    for (let n = 0; n < objects.length; n++) yield { model: placed, corner, transform: transforms.subarray(16 * n, 16 * n + 16), first: objects[n]! };
  }
}

/** A ray in a model's frame, where it is as long as it was; null: the transform makes the model flat. */
function rayFrom({ eye, direction }: Ray, corner: Vector3, transform: Float32Array | null): Ray | null {
  const from: Vector3 = [eye[0] - corner[0], eye[1] - corner[1], eye[2] - corner[2]];
  if (!transform) return { eye: from, direction };
  const matrix = new Matrix4().fromArray(transform);
  if (matrix.determinant() === 0) return null;
  const m = matrix.invert().elements;
  const row = (a: 0 | 1 | 2, [x, y, z]: Vector3): number => m[a]! * x + m[a + 4]! * y + m[a + 8]! * z;
  return {
    eye: [row(0, from) + m[12]!, row(1, from) + m[13]!, row(2, from) + m[14]!],
    direction: [row(0, direction), row(1, direction), row(2, direction)],
  };
}

/** Whether the box of a geometry may hold the point at a distance, or what is near enough to it on the ray. */
function meets(geometry: BufferGeometry, { eye, direction }: Ray, distance: number): boolean {
  if (!geometry.boundingBox) geometry.computeBoundingBox();
  const { min, max } = geometry.boundingBox!;
  return (["x", "y", "z"] as const).every((axis, a) => {
    const [one, other] = [1 - TOLERANCE, 1 + TOLERANCE].map((times) => eye[a]! + times * distance * direction[a]!) as [number, number];
    return Math.max(one, other) >= min[axis] && Math.min(one, other) <= max[axis];
  });
}

function nearestTriangle(geometry: BufferGeometry, { eye, direction }: Ray, distance: number): { triangle: number; away: number } {
  const { index } = geometry;
  const position = geometry.getAttribute("position") as BufferAttribute;
  const count = Math.floor((index ?? position).count / 3);
  let [triangle, away] = [0, Infinity];
  const cornerOf = (n: number): Vector3 => {
    const row = index ? index.getX(n) : n;
    return [position.getX(row), position.getY(row), position.getZ(row)];
  };
  for (let n = 0; n < count; n++) {
    const at = meeting(eye, direction, cornerOf(3 * n), cornerOf(3 * n + 1), cornerOf(3 * n + 2));
    // Not for NaN either.
    if (Math.abs(at - distance) < away) [triangle, away] = [n, Math.abs(at - distance)];
  }
  return { triangle, away };
}

/** Where a ray goes through a triangle, in its own lengths; NaN when it does not (Möller and Trumbore 1997, Fast, Minimum Storage Ray/Triangle Intersection). */
function meeting(eye: Vector3, direction: Vector3, a: Vector3, b: Vector3, c: Vector3): number {
  const [ab, ac] = [less(b, a), less(c, a)];
  const across = cross(direction, ac);
  const volume = dot(ab, across);
  const from = less(eye, a);
  const u = dot(from, across) / volume;
  const turned = cross(from, ab);
  const v = dot(direction, turned) / volume;
  return u >= -EDGE && v >= -EDGE && u + v <= 1 + EDGE ? dot(ac, turned) / volume : NaN;
}

function less(a: Vector3, b: Vector3): Vector3 {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}
