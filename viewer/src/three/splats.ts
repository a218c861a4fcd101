import {
  GLSL3, GreaterDepth, Matrix3, NoBlending, Points, RawShaderMaterial, Vector2, Vector3, type BufferGeometry, type DataTexture,
  type Group, type WebGLRenderer,
} from "three";
import type { Culler } from "../core/culling.js";
import type { Grid } from "../core/grid.js";
import { HOLE } from "../core/holes.js";
import type { PictureDraw } from "../core/plan.js";
import { along } from "../core/projection.js";
import type { Vector3 as Triple } from "../core/vector.js";
import { HoleTexture, holeUniforms, setHoles } from "./holetexture.js";
import type { LightUniforms } from "./light.js";
import type { OrthoviewTile } from "./orthoviewtile.js";
import type { Viewpoint } from "./viewpoint.js";
import holesText from "./shaders/holes.glsl";
import lightText from "./shaders/light.glsl";
import normalText from "./shaders/normal.glsl";
import fragmentText from "./shaders/splat.frag.glsl";
import vertexText from "./shaders/splat.vert.glsl";

const PRECISION = "precision highp float;\nprecision highp int;\n";

/** What one draw call needs besides what all share. */
interface Placement {
  readonly tile: OrthoviewTile;
  readonly draw: PictureDraw;
  readonly holeNode: number;
  /** Which of the culler's ranges are its own. */
  readonly from: number;
  readonly length: number;
}

/** What a picture of splats depends on besides its tiles. */
export interface SplatView {
  readonly viewpoint: Viewpoint;
  readonly sun: Triple;
  /** Widest point the card draws. */
  readonly largest: number;
  /** Decides what is drawn. */
  readonly culler: Culler;
  /** Whether what faces away is drawn too. */
  readonly bothSides: boolean;
}

/** Draws orthoviews as splats, the runs of a tile's pixels that may be seen in one call. */
export class Splats {
  /** Tiles drawn last. */
  tiles = 0;
  /** What was drawn last. */
  culler: Culler | null = null;
  private readonly pool: Points<BufferGeometry, RawShaderMaterial>[] = [];
  private readonly placements = new WeakMap<object, Placement>();
  private readonly material: RawShaderMaterial;
  private readonly holes: HoleTexture;
  private readonly ofCell = holeUniforms();
  private multiDraw: WEBGL_multi_draw | null = null;
  private viewpoint: Viewpoint | null = null;
  private sun: Triple = [0, 0, 1];

  constructor(
    private readonly group: Group,
    grid: Grid,
    light: LightUniforms,
  ) {
    this.holes = new HoleTexture(grid);
    this.material = new RawShaderMaterial({
      name: "farfield splats",
      glslVersion: GLSL3,
      vertexShader: [PRECISION, lightText, holesText, normalText, vertexText].join("\n"),
      fragmentShader: [PRECISION, lightText, holesText, normalText, fragmentText].join("\n"),
      depthFunc: GreaterDepth,
      blending: NoBlending,
      uniforms: {
        ...light,
        origin: { value: new Vector3() },
        pitch: { value: 1 },
        behind: { value: 0 },
        texels: { value: null as DataTexture | null },
        lattice: { value: new Int32Array(2) },
        toX: { value: new Vector3() },
        toY: { value: new Vector3() },
        toW: { value: new Vector3() },
        sun: { value: new Vector3() },
        focal: { value: 1 },
        near: { value: 1 },
        largest: { value: 64 },
        bothSides: { value: false },
        frame: { value: new Vector2() },
        toWorld: { value: new Matrix3() },
        ...this.holes.uniforms,
        ...this.ofCell,
      },
    });
  }

  /** Takes what is to be drawn; what is certain not to be seen is left out. */
  set(draws: readonly PictureDraw[], { viewpoint, sun, largest, culler, bothSides }: SplatView): void {
    this.viewpoint = viewpoint;
    this.sun = sun;
    this.tiles = 0;
    this.holes.clear();
    this.culler = culler;
    for (const draw of draws) {
      const holeNode = this.holes.add(draw.holes);
      for (const { payload } of draw.tiles) {
        const tile = payload as OrthoviewTile;
        if (!culler.add(tile)) continue;
        const { from, length } = culler.ranges;
        this.place({ tile, draw, holeNode, from, length }, this.tiles++);
      }
    }
    for (let n = this.tiles; n < this.pool.length; n++) this.pool[n]!.visible = false;
    const { uniforms } = this.material;
    uniforms["focal"]!.value = viewpoint.focal;
    uniforms["near"]!.value = viewpoint.near;
    uniforms["largest"]!.value = largest;
    uniforms["bothSides"]!.value = bothSides;
    (uniforms["frame"]!.value as Vector2).set(viewpoint.width, viewpoint.height);
    this.holes.upload();
  }

  dispose(): void {
    this.material.dispose();
    this.holes.dispose();
    for (const points of this.pool) this.group.remove(points);
  }

  private place(placement: Placement, number: number): void {
    let points = this.pool[number];
    if (!points) {
      points = new Points(placement.tile.geometry, this.material);
      points.frustumCulled = false;
      points.matrixAutoUpdate = false;
      const self = points;
      points.onBeforeRender = () => this.prepare(this.placements.get(self)!);
      points.onAfterRender = (renderer) => this.drawRest(renderer, this.placements.get(self)!);
      this.pool.push(points);
      this.group.add(points);
    }
    points.geometry = placement.tile.geometry;
    points.visible = true;
    this.placements.set(points, placement);
  }

  private prepare({ tile, draw, holeNode, from }: Placement): void {
    const { firsts, counts } = this.culler!.ranges;
    tile.geometry.setDrawRange(firsts[from]!, counts[from]!);
    const { uniforms } = this.material;
    const { eye, toX, toY, toW } = this.viewpoint!;
    const { axes, pitch } = tile.lattice;
    const set = (name: string, value: Triple): void => void (uniforms[name]!.value as Vector3).set(...value);
    set("origin", tile.originFrom(eye));
    set("toX", along(toX, axes));
    set("toY", along(toY, axes));
    set("toW", along(toW, axes));
    set("sun", along(this.sun, axes));
    uniforms["pitch"]!.value = pitch;
    uniforms["behind"]!.value = draw.behind ? pitch : 0;
    uniforms["texels"]!.value = tile.texels;
    (uniforms["lattice"]!.value as Int32Array).set(tile.first);
    setHoles(this.ofCell, draw.cell, holeNode, eye);
    if (holeNode !== HOLE) {
      const { u, v, w } = axes;
      (uniforms["toWorld"]!.value as Matrix3).set(u[0], v[0], w[0], u[1], v[1], w[1], u[2], v[2], w[2]);
    }
    this.material.uniformsNeedUpdate = true;
  }

  /** Draws a tile's ranges after the first, which three.js has drawn: all that drawing needs is bound still. */
  private drawRest(renderer: WebGLRenderer, { from, length }: Placement): void {
    if (length === 1) return;
    const { firsts, counts } = this.culler!.ranges;
    const gl = renderer.getContext() as WebGL2RenderingContext;
    this.multiDraw ??= renderer.extensions.get("WEBGL_multi_draw") as WEBGL_multi_draw | null;
    if (this.multiDraw) this.multiDraw.multiDrawArraysWEBGL(gl.POINTS, firsts, from + 1, counts, from + 1, length - 1);
    else for (let n = from + 1; n < from + length; n++) gl.drawArrays(gl.POINTS, firsts[n]!, counts[n]!);
  }
}
