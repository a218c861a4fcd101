import {
  AlwaysDepth, BufferGeometry, Camera, Float32BufferAttribute, GLSL3, Mesh, NoBlending, RawShaderMaterial, Scene, type IUniform,
  type WebGLRenderer,
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
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new Float32BufferAttribute([-1, -1, 0, 3, -1, 0, -1, 3, 0], 3));
    const material = new RawShaderMaterial({
      name: `farfield ${name}`,
      glslVersion: GLSL3,
      vertexShader: vertexText,
      fragmentShader: PRECISION + fragmentText,
      depthFunc: AlwaysDepth,
      blending: NoBlending,
      uniforms,
    });
    this.mesh = new Mesh(geometry, material);
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
