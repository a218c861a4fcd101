import { DynamicDrawUsage, InstancedBufferAttribute, InstancedMesh, type Group, type RawShaderMaterial, type BufferGeometry } from "three";
import type { Cell } from "../../core/cell.js";
import type { Vector3 } from "../../core/vector.js";
import type { NearMaterials } from "./materials.js";
import type { NearModel, NearPart } from "./model.js";

/** A leaf that is drawn as geometry. */
export interface DrawnLeaf {
  readonly cell: Cell;
  readonly model: NearModel;
  readonly level: number;
}

/** Instances of one shared mesh: a draw call a part. */
export class InstancedModel {
  /** Instances placed last. */
  count = 0;
  readonly triangles: number;
  protected readonly meshes: readonly InstancedMesh<BufferGeometry, RawShaderMaterial>[];
  private anchor: Vector3 = [0, 0, 0];

  constructor(
    private readonly group: Group,
    private readonly model: NearModel,
    materialOf: (part: NearPart) => RawShaderMaterial,
  ) {
    this.triangles = model.parts.reduce((sum, part) => sum + part.triangles, 0);
    this.meshes = model.parts.map((part) => {
      const mesh = new InstancedMesh(part.geometry, materialOf(part), 1);
      mesh.frustumCulled = false;
      mesh.matrixAutoUpdate = mesh.matrixWorldAutoUpdate = false;
      group.add(mesh);
      return mesh;
    });
  }

  /** Whether it was made from this model and not from one that was dropped since. */
  isOf(model: NearModel): boolean {
    return this.model === model;
  }

  /** Places exactly these instances: (16, n) columns first, to what lies about the anchor. */
  put(chosen: Float32Array, anchor: Vector3): void {
    this.anchor = anchor;
    this.count = chosen.length / 16;
    for (const mesh of this.meshes) {
      if (mesh.instanceMatrix.count < this.count) {
        mesh.dispose();
        mesh.instanceMatrix = new InstancedBufferAttribute(new Float32Array(chosen.length * 2), 16);
        mesh.instanceMatrix.setUsage(DynamicDrawUsage);
      }
      mesh.count = this.count;
      mesh.visible = this.count > 0;
      mesh.instanceMatrix.array.set(chosen);
      mesh.instanceMatrix.needsUpdate = true;
    }
  }

  /** Follows the eye. */
  moveTo(eye: Vector3): void {
    const [x, y, z] = [0, 1, 2].map((a) => this.anchor[a]! - eye[a]!);
    for (const mesh of this.meshes) mesh.matrixWorld.makeTranslation(x!, y!, z!);
  }

  dispose(): void {
    for (const mesh of this.meshes) {
      this.group.remove(mesh);
      mesh.material.dispose();
      mesh.dispose();
    }
  }
}

/** The same of a mesh that leaves drawn as geometry name, clipped to those that are drawn at the levels it is of. */
export class ClippedModel extends InstancedModel {
  constructor(
    group: Group,
    private readonly hash: string,
    model: NearModel,
    materials: NearMaterials,
  ) {
    super(group, model, (part) => materials.make(part, "clipped"));
  }

  /** Places the instances that reach into the leaves, each once. */
  place(leaves: readonly DrawnLeaf[], anchor: Vector3): void {
    const own = leaves.filter(({ model }) => model.placements.some(({ mesh }) => mesh === this.hash));
    const levels = own.reduce((bits, { level }) => bits | (1 << level), 0);
    for (const { material } of this.meshes) material.uniforms["levels"]!.value = levels;
    this.put(collect(own, this.hash, anchor), anchor);
  }
}

/** Transforms of a mesh's instances relative to the anchor; an instance listed in several leaves comes once. */
function collect(leaves: readonly DrawnLeaf[], hash: string, anchor: Vector3): Float32Array {
  const chosen: number[] = [];
  const seen = new Set<string>();
  for (const { cell, model } of leaves) {
    const shift = [0, 1, 2].map((a) => cell.box.lower[a]! - anchor[a]!);
    for (const { mesh, transforms, objects } of model.placements) {
      if (mesh !== hash) continue;
      for (let n = 0; n < objects.length; n++) {
        const matrix = transforms.subarray(n * 16, n * 16 + 16);
        const at = [0, 1, 2].map((a) => matrix[12 + a]! + shift[a]!);
        const name = `${objects[n]} ${at.map((x) => Math.round(x * 50)).join(" ")}`;
        if (objects[n] !== 0 ? seen.has(`${objects[n]}`) : seen.has(name)) continue;
        seen.add(objects[n] !== 0 ? `${objects[n]}` : name);
        chosen.push(...matrix.subarray(0, 12), at[0]!, at[1]!, at[2]!, 1);
      }
    }
  }
  return Float32Array.from(chosen);
}
