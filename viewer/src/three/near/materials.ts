import { DoubleSide, GLSL3, GreaterDepth, NoBlending, RawShaderMaterial, Vector2, Vector3, Vector4, type Data3DTexture, type IUniform } from "three";
import type { Vector3 as Triple } from "../../core/vector.js";
import type { HoleTexture, holeUniforms } from "../holetexture.js";
import type { LightUniforms } from "../light.js";
import type { Viewpoint } from "../viewpoint.js";
import type { NearPart } from "./model.js";
import holesText from "../shaders/holes.glsl";
import lightText from "../shaders/light.glsl";
import fragmentText from "../shaders/near.frag.glsl";
import vertexText from "../shaders/near.vert.glsl";

const PRECISION = "precision highp float;\nprecision highp int;\n";

/** For which holes of a cell it is drawn, and how far behind what is finer. */
export type SolidUniforms = ReturnType<typeof holeUniforms> & { readonly behind: { value: number }; readonly margin: { value: number } };

/** Makes the materials of near geometry, which share what depends on the view and the light. */
export class NearMaterials {
  readonly leaves: { value: Data3DTexture | null } = { value: null };
  readonly leavesLower = { value: new Vector3() };
  /** Metres: of what is placed by itself nothing is drawn in leaves nearer than this. */
  readonly leftOut = { value: 0 };
  private readonly shared = {
    toX: { value: new Vector3() },
    toY: { value: new Vector3() },
    toW: { value: new Vector3() },
    sun: { value: new Vector3() },
    frame: { value: new Vector2() },
    near: { value: 1 },
  };

  constructor(
    private readonly light: LightUniforms,
    private readonly leafSize: number,
    private readonly holes: HoleTexture,
  ) {}

  set({ toX, toY, toW, width, height, near }: Viewpoint, sun: Triple): void {
    this.shared.toX.value.set(...toX);
    this.shared.toY.value.set(...toY);
    this.shared.toW.value.set(...toW);
    this.shared.sun.value.set(...sun);
    this.shared.frame.value.set(width, height);
    this.shared.near.value = near;
  }

  /** Of a cell above the leaves, whose place is only a shift too, and which is drawn where it stands in. */
  makeSolid(part: NearPart, place: SolidUniforms): RawShaderMaterial {
    return this.make(part, "solid", { ...this.holes.uniforms, ...place });
  }

  /**
   * kind: of a leaf, whose place is only a shift; of a cell above (makeSolid); of a mesh that is placed many times, clipped to leaves or whole; or of an object that
   * moves and turns.
   */
  make({ surface, geometry }: NearPart, kind: "leaf" | "solid" | "clipped" | "placed" | "moving", own: Record<string, IUniform> = {}): RawShaderMaterial {
    const defines: Record<string, string> = {};
    if (surface.map) defines["TEXTURED"] = "";
    if (surface.cutoff > 0) defines["CUT_OUT"] = "";
    if (surface.colored) defines["COLORED"] = "";
    if (surface.unlit) defines["UNLIT"] = "";
    if (kind === "clipped" || kind === "placed") defines["INSTANCED"] = "";
    if (kind === "clipped") defines["CLIPPED"] = "";
    if (kind === "placed") defines["PLACED"] = "";
    if (kind === "moving") defines["MOVING"] = "";
    if (kind === "solid") defines["SOLID"] = "";
    if (!geometry.hasAttribute("normal")) geometry.computeVertexNormals();
    const lattice = { leavesLower: this.leavesLower, leafSize: { value: this.leafSize } };
    return new RawShaderMaterial({
      name: "farfield near geometry",
      glslVersion: GLSL3,
      defines,
      vertexShader: [PRECISION, vertexText].join("\n"),
      fragmentShader: [PRECISION, lightText, ...(kind === "solid" ? [holesText] : []), fragmentText].join("\n"),
      // As the bake sees surfaces: from both sides.
      side: DoubleSide,
      depthFunc: GreaterDepth,
      blending: NoBlending,
      uniforms: {
        ...this.shared,
        ...this.light,
        ...own,
        ...(kind === "clipped" ? { ...lattice, leaves: this.leaves, levels: { value: 0 } } : {}),
        ...(kind === "placed" ? { ...lattice, leftOut: this.leftOut } : {}),
        map: { value: surface.map },
        factor: { value: new Vector4(...surface.factor) },
        cutoff: { value: surface.cutoff },
      },
    });
  }
}

