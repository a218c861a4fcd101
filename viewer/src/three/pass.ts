import {
  AlwaysDepth, BufferGeometry, Camera, Float32BufferAttribute, GLSL3, Mesh, NoBlending, RawShaderMaterial, Scene, type IUniform,
  type WebGLRenderer, type WebGLRenderTarget,
} from "three";
import vertexText from "./shaders/whole.vert.glsl";

const PRECISION = "precision highp float;\nprecision highp int;\n";

/** A fragment shader over all of a target. */
export class Pass<Uniforms extends Record<string, IUniform>> {
  private readonly scene = new Scene();
  private readonly camera = new Camera();
  private readonly mesh: Mesh<BufferGeometry, RawShaderMaterial>;

  constructor(
    name: string,
    fragmentText: string,
    readonly uniforms: Uniforms,
  ) {
    const material = new RawShaderMaterial({
      name: `farfield ${name}`,
      glslVersion: GLSL3,
      vertexShader: vertexText,
      fragmentShader: PRECISION + fragmentText,
      depthFunc: AlwaysDepth,
      blending: NoBlending,
      uniforms,
    });
    this.mesh = new Mesh(wholeTriangle(), material);
    this.mesh.frustumCulled = false;
    this.scene.add(this.mesh);
  }

  /** Draws into the target that is set. */
  draw(renderer: WebGLRenderer): void {
    renderer.render(this.scene, this.camera);
  }

  dispose(): void {
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }
}

/** One triangle over all of a target. */
export function wholeTriangle(): BufferGeometry {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute([-1, -1, 0, 3, -1, 0, -1, 3, 0], 3));
  return geometry;
}

/** Draws into a target without clearing it, and leaves the renderer as it was. */
export function drawApart(renderer: WebGLRenderer, target: WebGLRenderTarget, draw: () => void): void {
  const before = {
    target: renderer.getRenderTarget(),
    autoClear: renderer.autoClear,
    shadows: renderer.shadowMap.autoUpdate,
    xr: renderer.xr.enabled,
  };
  renderer.autoClear = false;
  renderer.shadowMap.autoUpdate = false;
  renderer.xr.enabled = false;
  renderer.setRenderTarget(target);
  draw();
  renderer.setRenderTarget(before.target);
  renderer.autoClear = before.autoClear;
  renderer.shadowMap.autoUpdate = before.shadows;
  renderer.xr.enabled = before.xr;
}
