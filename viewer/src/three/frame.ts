import {
  AlwaysDepth, CustomBlending, DepthTexture, FloatType, Mesh, NearestFilter, NoColorSpace, OneFactor, OneMinusSrcAlphaFactor,
  RGBAFormat, ShaderMaterial, SRGBColorSpace, UnsignedByteType, Vector2, WebGLRenderTarget,
  type BufferGeometry, type Camera, type IUniform, type Object3D, type Scene, type Texture, type WebGLRenderer,
} from "three";
import { FadeClock } from "../core/fadeclock.js";
import type { Air } from "./air.js";
import { DepthProbe } from "./depthprobe.js";
import { Fading } from "./fading.js";
import type { LightUniforms } from "./light.js";
import { drawApart, Pass, wholeTriangle } from "./pass.js";
import type { Shadows } from "./shadows.js";
import copyText from "./shaders/copy.frag.glsl";
import depthText from "./shaders/depth.glsl";
import fadedText from "./shaders/faded.glsl";
import pastText from "./shaders/past.glsl";
import averageText from "./shaders/resolve.frag.glsl";
import vertexText from "./shaders/resolve.vert.glsl";
import shadowText from "./shaders/shadow.glsl";
import shownText from "./shaders/shown.frag.glsl";
import skyText from "./shaders/sky.glsl";
import type { Viewpoint } from "./viewpoint.js";

/** The larger frame that the world is drawn into, and the triangle that shows it, averaged down, in the scene. */
export class Frame {
  /** Seconds in which what is shown goes over into what is drawn; 0: at once. */
  fade = 0;
  /** Share of the time between two pictures for which a shutter is open. */
  shutter = 0;
  private readonly screen: Mesh<BufferGeometry, ShaderMaterial>;
  /** Shows the frame itself. */
  private readonly resolve: ShaderMaterial;
  /** Shows what the frame and what was shown before give together. */
  private readonly shown: ShaderMaterial;
  private readonly fading: Fading;
  private readonly clock = new FadeClock();
  private target: WebGLRenderTarget | null = null;
  /** The same with what moves; null while nothing does. */
  private over: WebGLRenderTarget | null = null;
  private readonly copy = new Pass("copy", copyText, {
    frame: { value: null as Texture | null },
    frameDepth: { value: null as Texture | null },
  });
  private readonly uniforms = {
    frame: { value: null as Texture | null },
    frameDepth: { value: null as Texture | null },
    samples: { value: 1 },
    ratio: { value: 1 },
    near: { value: 1 },
    depthOf: { value: new Vector2() },
    picture: { value: null as Texture | null },
    pictureDepth: { value: null as Texture | null },
    shutter: { value: 0 },
  };
  private readonly probe = new DepthProbe();
  /** Of the picture, pixels. */
  private readonly size = new Vector2();
  /** Pixels of the frame for one of the picture, a side: whole, or less than 1. */
  private ratio = 1;

  constructor(light: LightUniforms, air: Air, shadows: Shadows) {
    const uniforms = { ...light, ...air.uniforms, ...shadows.uniforms, ...this.uniforms };
    const averaging = [skyText, shadowText, depthText, averageText].join("\n");
    this.resolve = this.materialOf("resolve", averaging, uniforms);
    this.fading = new Fading(vertexText, [pastText, fadedText, averaging].join("\n"), uniforms);
    const showing = { ...air.uniforms, ...this.fading.uniforms, ...this.uniforms };
    this.shown = this.materialOf("shown", [pastText, depthText, shownText].join("\n"), showing);
    this.screen = new Mesh(wholeTriangle(), this.resolve);
    this.screen.frustumCulled = false;
    this.screen.renderOrder = -Infinity;
    this.screen.visible = false;
  }

  /** Whether what is shown is still on its way to what was drawn. */
  get isFading(): boolean {
    return (this.fade > 0 && this.clock.fading) || (this.shutter > 0 && !this.fading.uniforms.pastSame.value);
  }

  /** Frame size for a picture of `width` x `height` pixels: as many samples a side as the card allows; less than 1 are fewer than pixels. */
  resize(renderer: WebGLRenderer, width: number, height: number, samples: number): { width: number; height: number } {
    const fitting = Math.floor(renderer.capabilities.maxTextureSize / Math.max(width, height));
    this.ratio = samples < 1 ? samples : Math.max(1, Math.min(Math.floor(samples), fitting));
    this.size.set(width, height);
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

  /**
   * The nearest sample of what was drawn last in a pixel of the picture, counted from its upper left corner: where in the frame it is, from below, and near /
   * distance; null: nothing is there.
   */
  async nearestIn(renderer: WebGLRenderer, x: number, y: number): Promise<{ readonly x: number; readonly y: number; readonly depth: number } | null> {
    const { target, ratio, size } = this;
    const [column, row] = [Math.floor(x), size.y - 1 - Math.floor(y)];
    if (!target || !(column >= 0 && column < size.x && row >= 0 && row < size.y)) return null;
    const side = Math.max(1, ratio);
    const place = (pixel: number): number => Math.floor(ratio < 1 ? (pixel + 0.5) * ratio : pixel * ratio);
    const depths = await this.probe.read(renderer, target.depthTexture!, [place(column), place(row)], side);
    const nearest = depths.reduce((best, depth, n) => (depth > depths[best]! ? n : best), 0);
    const depth = depths[nearest]!;
    if (!(depth > 0)) return null;
    return { x: place(column) + (nearest % side) + 0.5, y: place(row) + Math.floor(nearest / side) + 0.5, depth };
  }

  /** Draws a scene into the frame, to be shown; it has been told of the viewpoint already. */
  draw(renderer: WebGLRenderer, scene: Scene, camera: Camera): void {
    renderInto(this.target!, renderer, scene, camera);
  }

  /** Shows what was drawn last with a scene over it, seen from the same viewpoint; null: without. */
  show(renderer: WebGLRenderer, camera: Camera, viewpoint: Viewpoint, over: Scene | null, how: ShowingHow): void {
    if (over) this.drawOver(renderer, over, camera);
    else this.leaveOver();
    this.set(this.over ?? this.target!, camera, viewpoint);
    if ((this.fade > 0 || this.shutter > 0) && canFade(renderer)) this.showFaded(renderer, viewpoint, how);
    else this.showAlone();
    this.screen.visible = true;
  }

  /** Nothing has been shown before. */
  forget(): void {
    this.fading.forget();
  }

  addTo(parent: Object3D): void {
    parent.add(this.screen);
  }

  dispose(): void {
    this.target?.dispose();
    this.leaveOver();
    this.copy.dispose();
    this.probe.dispose();
    this.fading.dispose();
    this.screen.geometry.dispose();
    this.resolve.dispose();
    this.shown.dispose();
  }

  private drawOver(renderer: WebGLRenderer, scene: Scene, camera: Camera): void {
    const { width, height, texture, depthTexture } = this.target!;
    this.over ??= makeTarget(width, height);
    this.copy.uniforms.frame.value = texture;
    this.copy.uniforms.frameDepth.value = depthTexture;
    drawApart(renderer, this.over, () => {
      this.copy.draw(renderer);
      renderer.render(scene, camera);
    });
  }

  private leaveOver(): void {
    this.over?.dispose();
    this.over = null;
  }

  private set({ texture, depthTexture }: WebGLRenderTarget, camera: Camera, { near }: Viewpoint): void {
    const { uniforms } = this;
    const p = camera.projectionMatrix.elements;
    uniforms.frame.value = texture;
    uniforms.frameDepth.value = depthTexture;
    uniforms.samples.value = Math.max(1, this.ratio);
    uniforms.ratio.value = this.ratio;
    uniforms.near.value = near;
    uniforms.depthOf.value.set(p[10]!, p[14]!);
  }

  private showFaded(renderer: WebGLRenderer, viewpoint: Viewpoint, { fresh, atOnce }: ShowingHow): void {
    const weight = this.clock.weight(performance.now(), fresh, atOnce ? 0 : this.fade);
    const { ratio, fading } = this;
    fading.blend(renderer, this.size, { viewpoint, ratio }, this.depth, weight);
    this.uniforms.shutter.value = atOnce ? 0 : this.shutter;
    this.uniforms.picture.value = fading.shown.texture;
    this.uniforms.pictureDepth.value = fading.shown.depthTexture;
    this.screen.material = this.shown;
  }

  private showAlone(): void {
    this.fading.forget();
    this.screen.material = this.resolve;
  }

  private materialOf(name: string, fragmentShader: string, uniforms: Record<string, IUniform>): ShaderMaterial {
    return new ShaderMaterial({
      name: `farfield ${name}`,
      vertexShader: vertexText,
      fragmentShader,
      depthFunc: AlwaysDepth,
      toneMapped: false,
      blending: CustomBlending,
      blendSrc: OneFactor,
      blendDst: OneMinusSrcAlphaFactor,
      uniforms,
    });
  }
}

/** How a frame is shown. */
export interface ShowingHow {
  /** It has been drawn anew since it was shown last. */
  readonly fresh: boolean;
  /** Nothing of what was shown before stays. */
  readonly atOnce: boolean;
}

function canFade({ extensions }: WebGLRenderer): boolean {
  return extensions.has("EXT_color_buffer_float") || extensions.has("EXT_color_buffer_half_float");
}

/** Draws a scene into a target that holds nothing yet, leaving the renderer as it was. */
export function renderInto(target: WebGLRenderTarget, renderer: WebGLRenderer, scene: Scene, camera: Camera): void {
  drawApart(renderer, target, () => {
    clear(renderer);
    renderer.render(scene, camera);
  });
}

/** Nothing anywhere: transparent, and infinitely far (depth is near / distance). */
function clear(renderer: WebGLRenderer): void {
  const gl = renderer.getContext() as WebGL2RenderingContext;
  renderer.state.buffers.color.setMask(true);
  renderer.state.buffers.depth.setMask(true);
  gl.clearBufferfv(gl.COLOR, 0, [0, 0, 0, 0]);
  gl.clearBufferfv(gl.DEPTH, 0, [0]);
}

/** A target as the world is drawn into: sRGB, and depth in single precision. */
export function makeTarget(width: number, height: number): WebGLRenderTarget {
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
