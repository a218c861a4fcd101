import {
  DepthTexture, FloatType, Matrix4, NearestFilter, NoColorSpace, RedFormat, UnsignedByteType, Vector3 as Three, WebGLRenderTarget,
  type WebGLRenderer,
} from "three";
import { cross, distance, dot, type Vector3 } from "../core/vector.js";
import { frustumOf, type Viewpoint } from "./viewpoint.js";

const MAPS = 4;
/** Texels a side; 20 MB a map. */
const SIZE = 2048;
/** The sun stands this many times the radius of a map away: as good as parallel (0.06 degrees), and still exact in single precision. */
const SUN_AWAY = 1000;
/** A map covers so much more than is asked of it, so that it stays good while the eye moves by a quarter. */
const ROOM = 1.25;
/** The smallest map reaches this many times as far as the nearest surface. */
const NEAREST = 3;
/** Each map reaches at most so many times as far as the one before: larger steps leave visibly coarse texels. */
const MOST_STEP = 8;

/** The scene's depth as the sun sees a sphere about the eye. */
interface ShadowMap {
  readonly target: WebGLRenderTarget;
  view: Viewpoint;
  middle: Vector3;
  radius: number;
  casters: number;
  sun: Vector3;
}

type DrawScene = (viewpoint: Viewpoint, target: WebGLRenderTarget) => void;

/** What is needed to know where shadows fall. */
export interface ShadowView {
  readonly eye: Vector3;
  readonly sun: Vector3;
  /** Metres to the nearest and the farthest surface. */
  readonly nearest: number;
  readonly farthest: number;
  /** Another number whenever something else casts shadows. */
  readonly casters: number;
}

/**
 * Shadows of the whole world, pictures and geometry alike: maps of depth, drawn by the same shaders from the sun, of
 * spheres about the eye. A map stays as it is as long as the eye is near its middle and nothing in it changes.
 */
export class Shadows {
  readonly uniforms = {
    shadowCount: { value: 0 },
    shadowRows: { value: Array.from({ length: MAPS }, () => new Matrix4()) },
    shadowSpheres: { value: Array.from({ length: MAPS }, () => new Three()) },
    ...Object.fromEntries(Array.from({ length: MAPS }, (_, n) => [`shadowMap${n}`, { value: null as DepthTexture | null }])),
  };
  /** Maps that are not as new as what they show. */
  stale = 0;
  private readonly maps: (ShadowMap | undefined)[] = [];

  /**
   * Draws the maps that are needed: all that are of no use any more, and one more that is not up to date.
   * draw: draws the scene as seen from a viewpoint into a target.
   */
  update(renderer: WebGLRenderer, view: ShadowView, draw: DrawScene): void {
    const size = Math.min(SIZE, renderer.capabilities.maxTextureSize);
    this.stale = 0;
    let spare = 1;
    const radii = radiiOf(view.nearest, view.farthest);
    radii.forEach((radius, n) => {
      const known = this.maps[n];
      const useful = known && known.target.width === size && isUseful(known, radius, view);
      if (useful && known.casters === view.casters) return;
      if (useful && spare-- <= 0) this.stale++;
      else this.maps[n] = this.drawn(size, radius, view, known, draw);
    });
    this.uniforms.shadowCount.value = radii.length;
    this.place(view.eye);
  }

  /** No shadows any more. */
  clear(): void {
    this.uniforms.shadowCount.value = this.stale = 0;
    for (const map of this.maps.splice(0)) map?.target.dispose();
    const named = this.uniforms as unknown as Record<string, { value: DepthTexture | null }>;
    for (let n = 0; n < MAPS; n++) named[`shadowMap${n}`]!.value = null;
  }

  private drawn(
    size: number, radius: number, { eye, sun, casters }: ShadowView, known: ShadowMap | undefined, draw: DrawScene,
  ): ShadowMap {
    const target = known?.target.width === size ? known.target : makeTarget(size);
    if (target !== known?.target) known?.target.dispose();
    const covered = radius * ROOM;
    const view = seenFromSun(sun, eye, covered, size);
    draw(view, target);
    return { target, view, middle: middleOf(view, covered), radius: covered, casters, sun };
  }

  private place(eye: Vector3): void {
    const named = this.uniforms as unknown as Record<string, { value: DepthTexture | null }>;
    for (let n = 0; n < MAPS; n++) {
      // Unused samplers need a texture too.
      const map = this.maps[n] ?? this.maps[0]!;
      const { toX, toY, toW, eye: from, near, width } = map.view;
      const shift: Vector3 = [eye[0] - from[0], eye[1] - from[1], eye[2] - from[2]];
      const row = (r: Vector3): number[] => [...r, dot(r, shift)];
      const middle = map.middle.map((m, a) => m - eye[a]!);
      this.uniforms.shadowRows.value[n]!.fromArray([...row(toX), ...row(toY), ...row(toW), ...middle, 0]);
      this.uniforms.shadowSpheres.value[n]!.set((2 * map.radius) / width, map.radius, near);
      named[`shadowMap${n}`]!.value = map.target.depthTexture;
    }
  }
}

/** Radii of the maps: evenly in steps from the nearest to the farthest surface; powers of √2, so that they rarely change. */
export function radiiOf(nearest: number, farthest: number): number[] {
  const last = rounded(Math.max(farthest, 1));
  const first = Math.min(last, rounded(NEAREST * Math.max(nearest, 0.5)));
  const steps = Math.min(MAPS - 1, Math.ceil(Math.log(last / first) / Math.log(2) - 1e-9));
  const step = steps > 0 ? Math.min(MOST_STEP, (last / first) ** (1 / steps)) : 1;
  return Array.from({ length: steps + 1 }, (_, n) => last / step ** (steps - n));
}

function rounded(metres: number): number {
  return 2 ** (Math.ceil(2 * Math.log2(metres)) / 2);
}

function isUseful(map: ShadowMap, radius: number, { eye, sun }: ShadowView): boolean {
  const same = map.sun.every((part, a) => part === sun[a]);
  return same && map.radius <= 2 * ROOM * radius && distance(map.middle, eye) + radius <= map.radius;
}

/** A view from the sun of a sphere about a middle, moved by less than a texel so that texels stay where they are. */
function seenFromSun(sun: Vector3, about: Vector3, radius: number, size: number): Viewpoint {
  const forward: Vector3 = [-sun[0], -sun[1], -sun[2]];
  const flat = Math.hypot(sun[0], sun[1]);
  const right: Vector3 = flat > 1e-6 ? [-sun[1] / flat, sun[0] / flat, 0] : [1, 0, 0];
  const up = cross(right, forward);
  const away = SUN_AWAY * radius;
  const texel = (2 * radius) / size;
  const snap = (axis: Vector3): number => Math.round(dot(about, axis) / texel) * texel;
  const [x, y, z] = [snap(right), snap(up), dot(about, forward) - away];
  const eye = [0, 1, 2].map((a) => right[a]! * x + up[a]! * y + forward[a]! * z) as unknown as Vector3;
  const focal = (away * size) / 2 / radius;
  const rowOf = (axis: Vector3): Vector3 => axis.map((part, a) => focal * part + (size / 2) * forward[a]!) as unknown as Vector3;
  const [toX, toY, near] = [rowOf(right), rowOf(up), away / 2];
  const frustum = frustumOf(eye, toX, toY, forward, near, size, size);
  return { eye, toX, toY, toW: forward, focal, near, frustum, tangent: radius / away, width: size, height: size };
}

function middleOf({ eye, toW }: Viewpoint, radius: number): Vector3 {
  return eye.map((part, a) => part + toW[a]! * SUN_AWAY * radius) as unknown as Vector3;
}

/** Depth alone is wanted; of the colour that a target must have, a byte a texel. */
function makeTarget(size: number): WebGLRenderTarget {
  const depthTexture = new DepthTexture(size, size, FloatType);
  depthTexture.colorSpace = NoColorSpace;
  return new WebGLRenderTarget(size, size, {
    format: RedFormat, type: UnsignedByteType, minFilter: NearestFilter, magFilter: NearestFilter, generateMipmaps: false,
    depthTexture,
  });
}
