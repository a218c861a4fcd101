import type { ImpostorForm } from "./impostors.js";
import type { InstancedMesh, MeshLevel } from "./indextile.js";
import type { Resource } from "./resource.js";
import { toldBy } from "./stream/accuracy.js";
import type { Box, Vector3 } from "./vector.js";

/** A shared mesh in one of its forms. */
export interface MeshForm {
  readonly entry: MeshLevel;
  /** 0 = full, the larger the coarser. */
  readonly level: number;
  readonly mesh: Resource;
  /** Hash and bytes of each image that it needs. */
  readonly images: ReadonlyMap<string, number>;
  /** How unlike the full mesh it looks, 0 to 1, as MeshLevel.errors: `errorAt` tells it, with MESH_FARTHEST. */
  readonly told: readonly number[];
}

/** All that a shared mesh can be drawn by, each from fine to coarse. */
export interface MeshForms {
  /** At least one. */
  readonly forms: readonly MeshForm[];
  readonly impostors: readonly ImpostorForm[];
}

/** One placement of a mesh. */
export interface Instance {
  /** Id of the mesh's object 0. */
  readonly object: number;
  /** (16,) columns first, from the mesh's frame to that of the leaf's lower corner. */
  readonly transform: Float32Array;
  /** Local metres. */
  readonly bounds: Box;
}

/**
 * Instances of a shared mesh that have their place in a leaf: one alone, from which they may reach into others. The lists of forms are the
 * same of all that are placed of the mesh.
 */
export interface PlacedMesh extends MeshForms {
  /** Lower corner of the leaf, local metres. */
  readonly corner: Vector3;
  /** At least one. */
  readonly instances: readonly Instance[];
  /** Of all of them, local metres. */
  readonly bounds: Box;
}

/** A mesh in the form of a level, 0 = full. */
export function meshForm(entry: MeshLevel, level: number, mesh: Resource): MeshForm {
  return { entry, level, mesh, images: mesh.images, told: entry.errors?.length ? toldBy(entry.errors) : [0, 0, 0] };
}

/** What the index tells of instances in a leaf, whose lower corner is given, of a mesh that has these forms. */
export function placedMesh({ bounds, objects, transforms }: InstancedMesh, corner: Vector3, { forms, impostors }: MeshForms): PlacedMesh {
  const instances = objects.map((object, n) => {
    const rows = transforms[n]!;
    return { object, transform: columnsOf(rows), bounds: boxOf(bounds, rows, corner) };
  });
  return { corner, forms, impostors, instances, bounds: around(instances.map((instance) => instance.bounds)) };
}

/** The finest form that is there, from a level on, or the coarsest of those that end before. */
export function heldMesh(forms: readonly MeshForm[], from = 0): MeshForm | null {
  return forms.find(({ mesh, level }) => mesh.held && level >= Math.min(from, forms.length - 1)) ?? null;
}

/** Forms that are on their way and finer than what is there. */
export function comingMeshes(forms: readonly MeshForm[]): readonly MeshForm[] {
  const coming: MeshForm[] = [];
  for (const form of forms) {
    if (form.mesh.held) break;
    if (form.mesh.coming) coming.push(form);
  }
  return coming;
}

/** The box around what of a box lies in leaves that are not left out; null: nothing does. corner: of one leaf. */
export function outsideOf({ lower, upper }: Box, corner: Vector3, leafSize: number, isLeftOut: (leaf: Box) => boolean): Box | null {
  const along = (axis: 0 | 1 | 2): number[] => {
    const first = Math.floor((lower[axis] - corner[axis]) / leafSize);
    const count = Math.max(Math.ceil((upper[axis] - corner[axis]) / leafSize) - first, 1);
    return Array.from({ length: count }, (_, n) => corner[axis] + (first + n) * leafSize);
  };
  const leaves = along(0).flatMap((x) => along(1).flatMap((y) => along(2).map((z): Box => ({ lower: [x, y, z], upper: [x + leafSize, y + leafSize, z + leafSize] }))));
  const parts = leaves.filter((leaf) => !isLeftOut(leaf)).map((leaf) => common(leaf, { lower, upper }));
  return parts.length > 0 ? around(parts) : null;
}

/** What two boxes share. */
function common(a: Box, b: Box): Box {
  const [x, y, z] = [0, 1, 2].map((n) => [Math.max(a.lower[n]!, b.lower[n]!), Math.min(a.upper[n]!, b.upper[n]!)]) as [[number, number], [number, number], [number, number]];
  return { lower: [x[0], y[0], z[0]], upper: [x[1], y[1], z[1]] };
}

/** The smallest box around some, of which there is at least one. */
export function around(boxes: readonly Box[]): Box {
  const side = (of: "lower" | "upper", pick: (...values: number[]) => number): Vector3 => {
    const along = (a: 0 | 1 | 2): number => boxes.reduce((found, box) => pick(found, box[of][a]), boxes[0]![of][a]);
    return [along(0), along(1), along(2)];
  };
  return { lower: side("lower", Math.min), upper: side("upper", Math.max) };
}

function columnsOf(rows: readonly number[]): Float32Array {
  const columns = new Float32Array(16);
  for (let n = 0; n < 12; n++) columns[(n % 4) * 4 + Math.floor(n / 4)] = rows[n]!;
  columns[15] = 1;
  return columns;
}

/** Box around a mesh's bounds where its instance stands. */
function boxOf([lower, upper]: readonly [Vector3, Vector3], rows: readonly number[], corner: Vector3): Box {
  const along = (a: 0 | 1 | 2, sign: -1 | 1): number => {
    let at = corner[a] + rows[4 * a + 3]!;
    for (let n = 0; n < 3; n++) {
      const part = rows[4 * a + n]!;
      at += part * (part * sign < 0 ? lower[n]! : upper[n]!);
    }
    return at;
  };
  return { lower: [along(0, -1), along(1, -1), along(2, -1)], upper: [along(0, 1), along(1, 1), along(2, 1)] };
}
