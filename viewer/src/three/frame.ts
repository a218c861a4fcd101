import {
  BufferGeometry, CustomBlending, DepthTexture, Float32BufferAttribute, FloatType, Mesh, NearestFilter, NoColorSpace, OneFactor,
  OneMinusSrcAlphaFactor, RGBAFormat, ShaderMaterial, SRGBColorSpace, UnsignedByteType, Vector2, WebGLRenderTarget,
  AlwaysDepth, type Camera, type Object3D, type Texture, type WebGLRenderer, type Scene,
} from "three";
import type { Air } from "./air.js";
import type { LightUniforms } from "./light.js";
import { Pass } from "./pass.js";
import type { Shadows } from "./shadows.js";
import copyText from "./shaders/copy.frag.glsl";
import fragmentText from "./shaders/resolve.frag.glsl";
import vertexText from "./shaders/resolve.vert.glsl";
import shadowText from "./shaders/shadow.glsl";
import skyText from "./shaders/sky.glsl";
import type { Viewpoint } from "./viewpoint.js";

/** The larger frame that the world is drawn into, and the triangle that averages it down into the scene. */
export class Frame {
  readonly resolve: Mesh<BufferGeometry, ShaderMaterial>;
  private target: WebGLRenderTarget | null = null;
  /** The same with what moves; null while nothing does. */
  private over: WebGLRenderTarget | null = null;
  private readonly copy = new Pass("copy", copyText, {
    frame: { value: null as Texture | null },
    frameDepth: { value: null as Texture | null },
  });
  /** Pixels of the frame for one of the picture, a side: whole, or less than 1. */
  private ratio = 1;

  constructor(light: LightUniforms, air: Air, shadows: Shadows) {
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new Float32BufferAttribute([-1, -1, 0, 3, -1, 0, -1, 3, 0], 3));
    const material = new ShaderMaterial({
      name: "farfield resolve",
      vertexShader: vertexText,
      fragmentShader: [skyText, shadowText, fragmentText].join("\n"),
      depthFunc: AlwaysDepth,
      toneMapped: false,
      blending: CustomBlending,
      blendSrc: OneFactor,
      blendDst: OneMinusSrcAlphaFactor,
      uniforms: {
        ...light,
        ...air.uniforms,
        ...shadows.uniforms,
        frame: { value: null },
        frameDepth: { value: null },
        samples: { value: 1 },
        ratio: { value: 1 },
        near: { value: 1 },
        depthOf: { value: new Vector2() },
      },
    });
    this.resolve = new Mesh(geometry, material);
    this.resolve.frustumCulled = false;
    this.resolve.renderOrder = -Infinity;
    this.resolve.visible = false;
  }

  /** Frame size for a picture of `width` x `height` pixels: as many samples a side as the card allows; less than 1 are fewer than pixels. */
  resize(renderer: WebGLRenderer, width: number, height: number, samples: number): { width: number; height: number } {
    const fitting = Math.floor(renderer.capabilities.maxTextureSize / Math.max(width, height));
    this.ratio = samples < 1 ? samples : Math.max(1, Math.min(Math.floor(samples), fitting));
    const size = { width: Math.ceil(width * this.ratio), height: Math.ceil(height * this.ratio) };
    if (this.target && this.target.width === size.width && this.target.height === size.height) return size;
    this.target?.dispose();
    this.target = makeTarget(size.width, size.height);
    this.leaveOver();
    return size;
  }

  /** Near / distance of what was drawn last, 0 where nothing is. */
  get depth(): DepthTexture {
    return this.target!.depthTexture!;
  }

  /** Draws a scene into the frame; it has been told of the viewpoint already. */
  draw(renderer: WebGLRenderer, scene: Scene, camera: Camera, viewpoint: Viewpoint): void {
    renderInto(this.target!, renderer, scene, camera);
    this.show(camera, viewpoint, this.target!);
  }

  /** Draws a scene over what was drawn last, from the same viewpoint; that stays as it is. */
  drawOver(renderer: WebGLRenderer, scene: Scene, camera: Camera, viewpoint: Viewpoint): void {
    const { width, height, texture, depthTexture } = this.target!;
    this.over ??= makeTarget(width, height);
    this.copy.uniforms.frame.value = texture;
    this.copy.uniforms.frameDepth.value = depthTexture;
    drawApart(renderer, this.over, () => {
      this.copy.draw(renderer);
      renderer.render(scene, camera);
    });
    this.show(camera, viewpoint, this.over);
  }

  /** Shows what was drawn last without anything over it. */
  showAlone(camera: Camera, viewpoint: Viewpoint): void {
    this.leaveOver();
    this.show(camera, viewpoint, this.target!);
  }

  private leaveOver(): void {
    this.over?.dispose();
    this.over = null;
  }

  addTo(parent: Object3D): void {
    parent.add(this.resolve);
  }

  dispose(): void {
    this.target?.dispose();
    this.leaveOver();
    this.copy.dispose();
    this.resolve.geometry.dispose();
    this.resolve.material.dispose();
  }

  private show(camera: Camera, { near }: Viewpoint, { texture, depthTexture }: WebGLRenderTarget): void {
    const { uniforms } = this.resolve.material;
    const p = camera.projectionMatrix.elements;
    uniforms["frame"]!.value = texture;
    uniforms["frameDepth"]!.value = depthTexture;
    uniforms["samples"]!.value = Math.max(1, this.ratio);
    uniforms["ratio"]!.value = this.ratio;
    uniforms["near"]!.value = near;
    (uniforms["depthOf"]!.value as Vector2).set(p[10]!, p[14]!);
    this.resolve.visible = true;
  }
}

/** Draws a scene into a target that holds nothing yet, leaving the renderer as it was. */
export function renderInto(target: WebGLRenderTarget, renderer: WebGLRenderer, scene: Scene, camera: Camera): void {
  drawApart(renderer, target, () => {
    clear(renderer);
    renderer.render(scene, camera);
  });
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

/** Nothing anywhere: transparent, and infinitely far (depth is near / distance). */
function clear(renderer: WebGLRenderer): void {
  const gl = renderer.getContext() as WebGL2RenderingContext;
  renderer.state.buffers.color.setMask(true);
  renderer.state.buffers.depth.setMask(true);
  gl.clearBufferfv(gl.COLOR, 0, [0, 0, 0, 0]);
  gl.clearBufferfv(gl.DEPTH, 0, [0]);
}

function makeTarget(width: number, height: number): WebGLRenderTarget {
  const depthTexture = new DepthTexture(width, height, FloatType);
  depthTexture.colorSpace = NoColorSpace;
  const target = new WebGLRenderTarget(width, height, {
    format: RGBAFormat,
    type: UnsignedByteType,
    colorSpace: SRGBColorSpace,
    minFilter: NearestFilter,
    magFilter: NearestFilter,
    generateMipmaps: false,
    depthTexture,
  });
  target.texture.internalFormat = "SRGB8_ALPHA8";
  return target;
}
