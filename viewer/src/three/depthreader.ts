import { NearestFilter, NoColorSpace, WebGLRenderTarget, type DepthTexture, type WebGLRenderer } from "three";
import { DepthPyramid } from "../core/depthpyramid.js";
import type { Projection } from "../core/projection.js";
import { drawApart, Pass } from "./pass.js";
import fragmentText from "./shaders/farthest.frag.glsl";

/** Pixels of a square, at least, and squares along the longer side of a picture, at most. */
const LEAST_TEXEL = 8;
const MOST_TEXELS = 240;
/** Pictures of which the card has not told yet, at most. */
const MOST_WAITING = 4;
const LOOK_MS = 3;

interface Waiting {
  readonly fence: WebGLSync;
  readonly buffer: WebGLBuffer;
  readonly view: Projection;
  readonly texel: number;
  readonly columns: number;
  readonly rows: number;
}

/** Reads back how far one sees in a picture, without waiting for the card: a fence tells when it is there. */
export class DepthReader {
  private readonly target = new WebGLRenderTarget(1, 1, {
    colorSpace: NoColorSpace, depthBuffer: false, generateMipmaps: false, minFilter: NearestFilter, magFilter: NearestFilter,
  });
  private readonly pass = new Pass("farthest", fragmentText, {
    frameDepth: { value: null as DepthTexture | null },
    texel: { value: LEAST_TEXEL },
  });
  private waiting: Waiting[] = [];
  private timer: ReturnType<typeof setTimeout> | undefined;
  private gl: WebGL2RenderingContext | null = null;

  /** found: told of the newest picture that has been read. */
  constructor(private readonly found: (pyramid: DepthPyramid) => void) {}

  /** Begins to read the depth of the picture `view`, which has been drawn. */
  read(renderer: WebGLRenderer, depth: DepthTexture, view: Projection): void {
    const texel = Math.max(LEAST_TEXEL, Math.ceil(Math.max(view.width, view.height) / MOST_TEXELS));
    const [columns, rows] = [Math.ceil(view.width / texel), Math.ceil(view.height / texel)];
    this.target.setSize(columns, rows);
    const { uniforms } = this.pass;
    uniforms.frameDepth.value = depth;
    uniforms.texel.value = texel;
    const gl = renderer.getContext() as WebGL2RenderingContext;
    this.gl = gl;
    let buffer: WebGLBuffer | null = null;
    drawApart(renderer, this.target, () => {
      this.pass.draw(renderer);
      buffer = fetchPixels(gl, columns, rows);
    });
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    if (!fence || !buffer) return;
    // The one that was drawn last is what counts.
    if (this.waiting.length === MOST_WAITING) this.drop(this.waiting.pop()!);
    this.waiting.push({ fence, buffer, view, texel, columns, rows });
    gl.flush();
    this.timer ??= setTimeout(() => this.look(), LOOK_MS);
  }

  /** Forgets what is being read. */
  clear(): void {
    clearTimeout(this.timer);
    this.timer = undefined;
    for (const waiting of this.waiting.splice(0)) this.drop(waiting);
  }

  dispose(): void {
    this.clear();
    this.target.dispose();
    this.pass.dispose();
  }

  private look(): void {
    const gl = this.gl!;
    this.timer = undefined;
    if (gl.isContextLost()) return this.clear();
    const signalled = ({ fence }: Waiting): boolean => gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.SIGNALED;
    const newest = this.waiting.findLastIndex(signalled);
    const done = this.waiting.splice(0, newest + 1);
    const pyramid = done.length > 0 ? pyramidOf(gl, done.at(-1)!) : null;
    for (const waiting of done) this.drop(waiting);
    if (this.waiting.length > 0) this.timer = setTimeout(() => this.look(), LOOK_MS);
    if (pyramid) this.found(pyramid);
  }

  private drop({ fence, buffer }: Waiting): void {
    this.gl!.deleteSync(fence);
    this.gl!.deleteBuffer(buffer);
  }
}

/** A buffer into which the card writes the picture that is bound. */
function fetchPixels(gl: WebGL2RenderingContext, columns: number, rows: number): WebGLBuffer {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
  gl.bufferData(gl.PIXEL_PACK_BUFFER, columns * rows * 4, gl.STREAM_READ);
  gl.readPixels(0, 0, columns, rows, gl.RGBA, gl.UNSIGNED_BYTE, 0);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  return buffer;
}

function pyramidOf(gl: WebGL2RenderingContext, { buffer, view, texel, columns, rows }: Waiting): DepthPyramid {
  const values = new Float32Array(columns * rows);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
  gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, values);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  return new DepthPyramid(view, texel, columns, values);
}
