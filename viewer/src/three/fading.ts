import {
  AlwaysDepth, Camera, DepthTexture, FloatType, HalfFloatType, LinearFilter, LinearSRGBColorSpace, Matrix3, Mesh, NearestFilter,
  NoBlending, NoColorSpace, RGBAFormat, Scene, ShaderMaterial, Vector2, Vector3, WebGLRenderTarget,
  type BufferGeometry, type IUniform, type Texture, type WebGLRenderer,
} from "three";
import { sameProjection } from "../core/projection.js";
import { drawApart, wholeTriangle } from "./pass.js";
import type { Viewpoint } from "./viewpoint.js";

/** A picture that was shown. */
interface Shown {
  readonly viewpoint: Viewpoint;
  /** Pixels of its frame for one of its own, a side. */
  readonly ratio: number;
}

/**
 * Lets what was shown before go over into what is drawn now, so that nothing pops when cells and tiles change (OV 5.3): the picture
 * before is moved to where its surfaces are now, and the new one blended into it by time where it shows the same surface.
 */
export class Fading {
  readonly uniforms = {
    past: { value: null as Texture | null },
    pastDepth: { value: null as Texture | null },
    stillDepth: { value: null as Texture | null },
    toPast: { value: new Matrix3() },
    pastShift: { value: new Vector3() },
    pastNear: { value: 1 },
    pastSame: { value: true },
    weight: { value: 1 },
  };
  private readonly scene = new Scene();
  private readonly mesh: Mesh<BufferGeometry, ShaderMaterial>;
  /** What is shown, and room for what will be next. */
  private targets: [WebGLRenderTarget, WebGLRenderTarget] | null = null;
  private before: Shown | null = null;

  /** fragmentText: averages a frame down; with FADED defined it blends as well. uniforms: what it needs besides. */
  constructor(vertexText: string, fragmentText: string, uniforms: Record<string, IUniform>) {
    const material = new ShaderMaterial({
      name: "farfield fading",
      vertexShader: vertexText,
      fragmentShader: fragmentText,
      defines: { FADED: 1 },
      depthFunc: AlwaysDepth,
      blending: NoBlending,
      uniforms: { ...uniforms, ...this.uniforms },
    });
    this.mesh = new Mesh(wholeTriangle(), material);
    this.mesh.frustumCulled = false;
    this.scene.add(this.mesh);
  }

  /** What is shown: linear light, times alpha; its depth texture has near / distance. */
  get shown(): WebGLRenderTarget {
    return this.targets![0];
  }

  /**
   * Makes the picture that is to be shown, so many pixels large, of a frame seen from a viewpoint.
   * stillDepth: of the frame without what moves. weight: of the new picture, up to 1 for nothing of the one before.
   */
  blend(renderer: WebGLRenderer, { x: width, y: height }: Vector2, now: Shown, stillDepth: DepthTexture, weight: number): void {
    const { targets } = this;
    if (!targets || targets[0].width !== width || targets[0].height !== height) {
      this.forget();
      this.targets = [makeTarget(width, height), makeTarget(width, height)];
    }
    const [past, next] = this.targets!;
    this.uniforms.stillDepth.value = stillDepth;
    this.uniforms.past.value = past.texture;
    this.uniforms.pastDepth.value = past.depthTexture;
    this.uniforms.weight.value = this.before ? weight : 1;
    this.uniforms.pastSame.value = true;
    if (this.before) this.place(this.before, now);
    drawApart(renderer, next, () => renderer.render(this.scene, new Camera()));
    this.targets = [next, past];
    this.before = now;
  }

  /** Nothing has been shown before. */
  forget(): void {
    for (const target of this.targets ?? []) target.dispose();
    this.targets = null;
    this.before = null;
    this.uniforms.pastSame.value = true;
  }

  dispose(): void {
    this.forget();
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }

  private place({ viewpoint: past, ratio }: Shown, { viewpoint: now, ratio: nowRatio }: Shown): void {
    const { toX, toY, toW } = past;
    const pixels = 1 / ratio;
    this.uniforms.toPast.value.set(
      toX[0] * pixels, toX[1] * pixels, toX[2] * pixels, toY[0] * pixels, toY[1] * pixels, toY[2] * pixels, ...toW,
    );
    this.uniforms.pastShift.value.set(now.eye[0] - past.eye[0], now.eye[1] - past.eye[1], now.eye[2] - past.eye[2]);
    this.uniforms.pastNear.value = past.near;
    this.uniforms.pastSame.value = ratio === nowRatio && sameProjection(past, now);
  }
}

/** Half floats: of 8 bits, what is blended in small shares would never arrive. */
function makeTarget(width: number, height: number): WebGLRenderTarget {
  const depthTexture = new DepthTexture(width, height, FloatType);
  depthTexture.colorSpace = NoColorSpace;
  depthTexture.minFilter = depthTexture.magFilter = NearestFilter;
  return new WebGLRenderTarget(width, height, {
    format: RGBAFormat,
    type: HalfFloatType,
    colorSpace: LinearSRGBColorSpace,
    minFilter: LinearFilter,
    magFilter: LinearFilter,
    generateMipmaps: false,
    depthTexture,
  });
}
