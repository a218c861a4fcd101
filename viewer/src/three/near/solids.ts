import { Mesh, type BufferGeometry, type Group, type RawShaderMaterial } from "three";
import type { Grid } from "../../core/grid.js";
import type { SolidDraw } from "../../core/plan.js";
import type { Vector3 } from "../../core/vector.js";
import { holeUniforms, setHoles, type HoleTexture } from "../holetexture.js";
import type { NearMaterials, SolidUniforms } from "./materials.js";
import type { NearModel } from "./model.js";

type SolidMesh = Mesh<BufferGeometry, RawShaderMaterial>;

/** A model of a cell above the leaves, and what its parts are drawn with. */
interface Solid {
  readonly meshes: readonly SolidMesh[];
  readonly uniforms: SolidUniforms;
}

/** Draws cells above the leaves as geometry of their own, where nothing finer covers them. */
export class SolidCells {
  /** Triangles drawn last. */
  triangles = 0;
  private readonly solids = new Map<NearModel, Solid>();

  constructor(
    private readonly group: Group,
    private readonly grid: Grid,
    private readonly materials: NearMaterials,
    private readonly holes: HoleTexture,
  ) {}

  /** Takes what is to be drawn, as seen from an eye. */
  set(draws: readonly SolidDraw[], eye: Vector3): void {
    this.triangles = 0;
    this.holes.clear();
    for (const { meshes } of this.solids.values()) for (const mesh of meshes) mesh.visible = false;
    for (const draw of draws) this.place(draw, eye);
    this.holes.upload();
  }

  /** Forgets a model that is about to be dropped. */
  forget(model: NearModel): void {
    for (const mesh of this.solids.get(model)?.meshes ?? []) {
      this.group.remove(mesh);
      mesh.material.dispose();
    }
    this.solids.delete(model);
  }

  dispose(): void {
    for (const model of [...this.solids.keys()]) this.forget(model);
    this.holes.dispose();
  }

  private place({ cell, form, holes, behind }: SolidDraw, eye: Vector3): void {
    const model = form.leaf.payload as NearModel;
    const { meshes, uniforms } = this.solidOf(model);
    setHoles(uniforms, cell, this.holes.add(holes), eye);
    const pitch = this.grid.pitch(cell.level);
    uniforms.margin.value = pitch;
    uniforms.behind.value = behind ? pitch : 0;
    const [x, y, z] = [0, 1, 2].map((a) => cell.box.lower[a]! - eye[a]!);
    for (const mesh of meshes) {
      mesh.matrixWorld.makeTranslation(x!, y!, z!);
      mesh.visible = true;
    }
    for (const { triangles } of model.parts) this.triangles += triangles;
  }

  private solidOf(model: NearModel): Solid {
    const found = this.solids.get(model) ?? this.make(model);
    this.solids.set(model, found);
    return found;
  }

  private make({ parts }: NearModel): Solid {
    const uniforms = { ...holeUniforms(), behind: { value: 0 }, margin: { value: 0 } };
    const meshes = parts.map((part) => {
      const mesh: SolidMesh = new Mesh(part.geometry, this.materials.makeSolid(part, uniforms));
      mesh.frustumCulled = false;
      mesh.matrixAutoUpdate = mesh.matrixWorldAutoUpdate = false;
      this.group.add(mesh);
      return mesh;
    });
    return { meshes, uniforms };
  }
}
