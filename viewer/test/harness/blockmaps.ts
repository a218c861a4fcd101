/** A page that draws BlockMaps alone, for tests/e2e/test_blockmaps.py. */
import { FloatType, Group, PerspectiveCamera, RGBAFormat, Matrix4, Scene, WebGLRenderer, WebGLRenderTarget, type Texture } from "three";
import { Culler } from "../../src/core/culling.js";
import { decodeBlockMap } from "../../src/core/blockmap/decode.js";
import { decodeColor } from "../../src/core/decode/color.js";
import { Grid } from "../../src/core/grid.js";
import type { Holes } from "../../src/core/holes.js";
import type { Vector3 } from "../../src/core/vector.js";
import { BlockMaps, type BlockMapDraw, type BlockMapView } from "../../src/three/blockmaps.js";
import { makeTarget, renderInto } from "../../src/three/frame.js";
import { DEFAULT_LIGHT, DEFAULT_SKY, LightUniforms, sunDirection } from "../../src/three/light.js";
import { drawApart, Pass } from "../../src/three/pass.js";
import { viewpointOf } from "../../src/three/viewpoint.js";

const COPY = "uniform highp sampler2D source; out vec4 value; void main() { value = texelFetch(source, ivec2(gl_FragCoord.xy), 0); }";

/** A BlockMap in its cell; bytes are base64. */
interface Placed {
  readonly bytes: string;
  readonly lower: Vector3;
  readonly upper: Vector3;
  readonly level: number;
  readonly holes: Holes;
  readonly behind: boolean;
}

interface Seen {
  readonly eye: Vector3;
  readonly target: Vector3;
  readonly fov: number;
  readonly near: number;
  readonly size: readonly [number, number];
}

const renderer = new WebGLRenderer();
const scene = new Scene();
const group = new Group();
scene.add(group);
const light = new LightUniforms();
light.set(DEFAULT_LIGHT, DEFAULT_SKY);
const grid = new Grid(64, 64, [0, 0, 0], [9, 9, 9]);
const maps = new BlockMaps(group, grid, light);
const copy = new Pass("copy of depth", COPY, { source: { value: null as Texture | null } });
let draws: BlockMapDraw[] = [];

/** Takes these maps in place of those before; see `add`. */
async function take(placed: readonly Placed[]): Promise<number> {
  for (const { handle } of draws) maps.drop(handle);
  draws = [];
  return add(placed);
}

/** Takes these maps, too; returns how many milliseconds it takes to decode one. */
async function add(placed: readonly Placed[]): Promise<number> {
  let milliseconds = 0;
  for (const { bytes, lower, upper, level, holes, behind } of placed) {
    const value = Uint8Array.from(atob(bytes), (letter) => letter.charCodeAt(0));
    const began = performance.now();
    const decoded = await decodeBlockMap(value, "map", decodeColor, [upper[0] - lower[0], upper[1] - lower[1]]);
    milliseconds += performance.now() - began;
    draws.push({ cell: { box: { lower, upper }, level }, handle: maps.upload(decoded), holes, behind });
  }
  return milliseconds / placed.length;
}

function look({ eye, target, fov, near, size }: Seen): { camera: PerspectiveCamera; view: BlockMapView } {
  const camera = new PerspectiveCamera(fov, size[0] / size[1], near, 1e6);
  camera.up.set(0, 0, 1);
  camera.position.set(...eye);
  camera.lookAt(...target);
  camera.updateMatrixWorld();
  const viewpoint = viewpointOf(camera, new Matrix4(), ...size);
  return { camera, view: { viewpoint, sun: sunDirection(DEFAULT_LIGHT), culler: new Culler(viewpoint, "all", null) } };
}

/** Rows from below: (height, width, 4) sRGB and light, and (height, width) near / d. */
function draw(seen: Seen): { color: string; depth: string; stats: BlockMaps["stats"] } {
  const [width, height] = seen.size;
  const { camera, view } = look(seen);
  const target = makeTarget(width, height);
  maps.set(draws, view);
  renderInto(target, renderer, scene, camera);
  const color = new Uint8Array(4 * width * height);
  renderer.readRenderTargetPixels(target, 0, 0, width, height, color);
  const copied = new WebGLRenderTarget(width, height, { format: RGBAFormat, type: FloatType, depthBuffer: false });
  copy.uniforms.source.value = target.depthTexture;
  drawApart(renderer, copied, () => copy.draw(renderer));
  const texels = new Float32Array(4 * width * height);
  renderer.readRenderTargetPixels(copied, 0, 0, width, height, texels);
  target.dispose();
  copied.dispose();
  const depth = texels.filter((_, at) => at % 4 === 0);
  return { color: base64(color), depth: base64(new Uint8Array(depth.buffer)), stats: maps.stats };
}

/** Milliseconds of each of some frames, drawn to the end. */
function time(seen: Seen, frames: number): number[] {
  const { camera, view } = look(seen);
  const target = makeTarget(...seen.size);
  const pixel = new Uint8Array(4);
  const taken = Array.from({ length: frames }, () => {
    const began = performance.now();
    maps.set(draws, view);
    renderInto(target, renderer, scene, camera);
    renderer.readRenderTargetPixels(target, 0, 0, 1, 1, pixel);
    return performance.now() - began;
  });
  target.dispose();
  return taken;
}

function base64(bytes: Uint8Array): string {
  let text = "";
  for (let at = 0; at < bytes.length; at += 1 << 15) text += String.fromCharCode(...bytes.subarray(at, at + (1 << 15)));
  return btoa(text);
}

Object.assign(globalThis, { harness: { take, add, draw, time, memory: () => renderer.info.memory } });
