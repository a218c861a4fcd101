import { NearestFilter, NoColorSpace, Vector2, WebGLRenderTarget, type DepthTexture, type WebGLRenderer } from "three";
import { drawApart, Pass } from "./pass.js";
import fragmentText from "./shaders/probe.frag.glsl";

/** Reads back the depth of a few samples of a picture, without waiting for the card. */
export class DepthProbe {
  private readonly target = new WebGLRenderTarget(1, 1, {
    colorSpace: NoColorSpace, depthBuffer: false, generateMipmaps: false, minFilter: NearestFilter, magFilter: NearestFilter,
  });
  private readonly pass = new Pass("probe", fragmentText, {
    frameDepth: { value: null as DepthTexture | null },
    first: { value: new Vector2() },
  });

  /** (side, side) near / distance of the samples from one on, to the right and upwards; all must lie in the picture. */
  async read(renderer: WebGLRenderer, depth: DepthTexture, [column, row]: readonly [number, number], side: number): Promise<Float32Array> {
    this.target.setSize(side, side);
    this.pass.uniforms.frameDepth.value = depth;
    this.pass.uniforms.first.value.set(column, row);
    drawApart(renderer, this.target, () => this.pass.draw(renderer));
    const bytes = new Uint8Array(4 * side * side);
    await renderer.readRenderTargetPixelsAsync(this.target, 0, 0, side, side, bytes);
    return new Float32Array(bytes.buffer);
  }

  dispose(): void {
    this.target.dispose();
    this.pass.dispose();
  }
}
