import { Mesh, type BufferGeometry, type Group, type RawShaderMaterial } from "three";
import type { Cell, CellGeometry } from "../../core/cell.js";
import type { Grid } from "../../core/grid.js";
import type { InstancesDraw, SolidDraw } from "../../core/plan.js";
import type { Vector3 } from "../../core/vector.js";
import { HoleTexture } from "../holetexture.js";
import type { LightUniforms } from "../light.js";
import type { Viewpoint } from "../viewpoint.js";
import { ClippedModel, type DrawnLeaf } from "./instances.js";
import { LeafLookup } from "./leaflookup.js";
import { NearMaterials } from "./materials.js";
import type { NearModel, NearPart } from "./model.js";
import { PlacedInstances } from "./placed.js";
import { SolidCells } from "./solids.js";

type LeafMesh = Mesh<BufferGeometry, RawShaderMaterial>;

/** What of a plan is drawn as geometry. */
export interface NearDraws {
  readonly leaves: readonly CellGeometry[];
  readonly solids: readonly SolidDraw[];
  /** By themselves. */
  readonly instances: readonly InstancesDraw[];
  /** Metres within which leaves are left out; 0: none are. */
  readonly leftOut: number;
}

/** Draws leaves as geometry: their own triangles, and the instances that reach into them, clipped to them. Others by themselves, and cells above. */
export class NearGeometry {
  private readonly materials: NearMaterials;
  private readonly lookup = new LeafLookup();
  private readonly leaves = new Map<NearModel, LeafMesh[]>();
  private readonly instanced = new Map<string, ClippedModel>();
  private readonly placed: PlacedInstances;
  private readonly solids: SolidCells;
  private drawn: DrawnLeaf[] = [];
  /** Of leaves and what is clipped to them. */
  private ownTriangles = 0;

  constructor(
    private readonly group: Group,
    private readonly grid: Grid,
    light: LightUniforms,
  ) {
    const holes = new HoleTexture(grid);
    this.materials = new NearMaterials(light, grid.leafSize, holes);
    this.placed = new PlacedInstances(group, this.materials);
    this.solids = new SolidCells(group, grid, this.materials, holes);
  }

  /** Triangles drawn last. */
  get triangles(): number {
    return this.ownTriangles + this.placed.triangles + this.solids.triangles;
  }

  /** Takes what is to be drawn. */
  set({ leaves, solids, instances, leftOut }: NearDraws, viewpoint: Viewpoint, sun: Vector3): void {
    this.materials.set(viewpoint, sun);
    this.materials.leftOut.value = leftOut;
    this.placed.set(instances, viewpoint.eye);
    this.solids.set(solids, viewpoint.eye);
    const drawn = leaves.map(({ leaf, level }) => ({ cell: leaf.cell!, model: leaf.payload as NearModel, level }));
    if (!sameLeaves(drawn, this.drawn) || this.meshesChanged(leaves)) this.change(drawn, leaves, viewpoint.eye);
    for (const { cell, model } of drawn) {
      const [x, y, z] = [0, 1, 2].map((a) => cell.box.lower[a]! - viewpoint.eye[a]!);
      for (const mesh of this.leaves.get(model)!) mesh.matrixWorld.makeTranslation(x!, y!, z!);
    }
    for (const model of this.instanced.values()) model.moveTo(viewpoint.eye);
    const [x, y, z] = [0, 1, 2].map(
      (a) => this.grid.corner[a]! + this.lookup.first[a]! * this.grid.leafSize - viewpoint.eye[a]!,
    );
    this.materials.leavesLower.value.set(x!, y!, z!);
  }

  /** Forgets a model that is about to be dropped. */
  forget(model: NearModel): void {
    this.placed.forget(model);
    this.solids.forget(model);
    for (const mesh of this.leaves.get(model) ?? []) this.remove(mesh);
    this.leaves.delete(model);
    this.drawn = this.drawn.filter((leaf) => leaf.model !== model);
    for (const [hash, instanced] of this.instanced) {
      if (!instanced.isOf(model)) continue;
      instanced.dispose();
      this.instanced.delete(hash);
    }
  }

  /** What a part of something that moves among the leaves is drawn with. */
  materialOfMoving(part: NearPart): RawShaderMaterial {
    return this.materials.make(part, "moving");
  }

  dispose(): void {
    for (const model of [...this.leaves.keys()]) this.forget(model);
    for (const model of this.instanced.values()) model.dispose();
    this.placed.dispose();
    this.solids.dispose();
    this.lookup.dispose();
  }

  private meshesChanged(leaves: readonly CellGeometry[]): boolean {
    return leaves.some(({ meshes }) =>
      meshes.some(({ key, payload }) => !this.instanced.get(hashOf(key))?.isOf(payload as NearModel)),
    );
  }

  private change(drawn: DrawnLeaf[], leaves: readonly CellGeometry[], eye: Vector3): void {
    this.drawn = drawn;
    const cells = drawn.map(({ cell }) => cell);
    this.lookup.set(drawn);
    this.materials.leaves.value = this.lookup.texture;
    for (const { model } of drawn) if (!this.leaves.has(model)) this.leaves.set(model, this.makeLeaf(model));
    const visible = new Set(drawn.map(({ model }) => model));
    for (const [model, meshes] of this.leaves) for (const mesh of meshes) mesh.visible = visible.has(model);
    for (const { key, payload } of leaves.flatMap(({ meshes }) => meshes)) this.makeInstanced(hashOf(key), payload as NearModel);
    const anchor = anchorOf(cells, eye);
    for (const model of this.instanced.values()) model.place(drawn, anchor);
    this.ownTriangles = this.countTriangles();
  }

  private makeLeaf(model: NearModel): LeafMesh[] {
    return model.parts.map((part) => {
      const mesh: LeafMesh = new Mesh(part.geometry, this.materials.make(part, "leaf"));
      mesh.frustumCulled = false;
      mesh.matrixAutoUpdate = mesh.matrixWorldAutoUpdate = false;
      this.group.add(mesh);
      return mesh;
    });
  }

  private makeInstanced(hash: string, model: NearModel): void {
    const known = this.instanced.get(hash);
    if (known?.isOf(model)) return;
    known?.dispose();
    this.instanced.set(hash, new ClippedModel(this.group, hash, model, this.materials));
  }

  private remove(mesh: LeafMesh): void {
    this.group.remove(mesh);
    mesh.material.dispose();
  }

  private countTriangles(): number {
    let sum = 0;
    for (const { model } of this.drawn) for (const part of model.parts) sum += part.triangles;
    for (const { count, triangles } of this.instanced.values()) sum += count * triangles;
    return sum;
  }
}

function hashOf(meshKey: string): string {
  return meshKey.slice(meshKey.indexOf("/") + 1);
}

function sameLeaves(a: readonly DrawnLeaf[], b: readonly DrawnLeaf[]): boolean {
  return a.length === b.length && a.every(({ model }, n) => model === b[n]!.model);
}

/** A corner near the eye: instances keep their precision relative to it. */
function anchorOf(cells: readonly Cell[], eye: Vector3): Vector3 {
  return cells[0]?.box.lower ?? eye;
}
