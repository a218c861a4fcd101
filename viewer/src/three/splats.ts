import {
  DataTexture, GLSL3, Matrix3, NoBlending, Points, RawShaderMaterial, RedIntegerFormat, UnsignedIntType, Vector2, Vector3,
  GreaterDepth, type BufferGeometry, type Group,
} from "three";
import { seesOrientedBox } from "../core/frustum.js";
import type { Grid } from "../core/grid.js";
import { HoleTable } from "../core/holes.js";
import type { PictureDraw } from "../core/plan.js";
import type { Vector3 as Triple } from "../core/vector.js";
import type { LightUniforms } from "./light.js";
import { along, type OrthoviewTile } from "./orthoviewtile.js";
import { relativeTo, type Viewpoint } from "./viewpoint.js";
import holesText from "./shaders/holes.glsl";
import lightText from "./shaders/light.glsl";
import fragmentText from "./shaders/splat.frag.glsl";
import vertexText from "./shaders/splat.vert.glsl";

const PRECISION = "precision highp float;\nprecision highp int;\n";
const TABLE_WIDTH = 1024;

/** What one draw call needs besides what all share. */
interface Placement {
  readonly tile: OrthoviewTile;
  readonly draw: PictureDraw;
  readonly holeNode: number;
}

/** Draws orthoviews as splats, one draw call a tile. */
export class Splats {
  /** Splats of the tiles drawn last. */
  count = 0;
  tiles = 0;
  private readonly pool: Points<BufferGeometry, RawShaderMaterial>[] = [];
  private readonly placements = new WeakMap<object, Placement>();
  private readonly material: RawShaderMaterial;
  private viewpoint: Viewpoint | null = null;
  private sun: Triple = [0, 0, 1];
  private table = new HoleTable();

  constructor(
    private readonly group: Group,
    grid: Grid,
    light: LightUniforms,
  ) {
    this.material = new RawShaderMaterial({
      name: "farfield splats",
      glslVersion: GLSL3,
      vertexShader: [PRECISION, lightText, holesText, vertexText].join("\n"),
      fragmentShader: [PRECISION, fragmentText].join("\n"),
      depthFunc: GreaterDepth,
      blending: NoBlending,
      uniforms: {
        ...light,
        origin: { value: new Vector3() },
        pitch: { value: 1 },
        lattice: { value: new Int32Array(2) },
        toX: { value: new Vector3() },
        toY: { value: new Vector3() },
        toW: { value: new Vector3() },
        sun: { value: new Vector3() },
        focal: { value: 1 },
        near: { value: 1 },
        largest: { value: 64 },
        frame: { value: new Vector2() },
        holes: { value: holeTexture(new Uint32Array(TABLE_WIDTH)) },
        holeNode: { value: 1 },
        toWorld: { value: new Matrix3() },
        cellLower: { value: new Vector3() },
        cellSize: { value: new Vector3() },
        cellLevel: { value: 0 },
        axisLevels: { value: Int32Array.from(grid.axisLevels) },
      },
    });
  }

  /** Takes what is to be drawn; tiles outside the frustum are left out. */
  set(draws: readonly PictureDraw[], viewpoint: Viewpoint, sun: Triple, largest: number): void {
    this.viewpoint = viewpoint;
    this.sun = sun;
    this.count = this.tiles = 0;
    this.table = new HoleTable();
    for (const draw of draws) {
      const holeNode = this.table.add(draw.holes);
      for (const { payload } of draw.tiles) {
        const tile = payload as OrthoviewTile;
        if (!seesOrientedBox(viewpoint.frustum, tile.box)) continue;
        this.place({ tile, draw, holeNode }, this.tiles++);
        this.count += tile.count;
      }
    }
    for (let n = this.tiles; n < this.pool.length; n++) this.pool[n]!.visible = false;
    const { uniforms } = this.material;
    uniforms["focal"]!.value = viewpoint.focal;
    uniforms["near"]!.value = viewpoint.near;
    uniforms["largest"]!.value = largest;
    (uniforms["frame"]!.value as Vector2).set(viewpoint.width, viewpoint.height);
    this.uploadTable();
  }

  dispose(): void {
    this.material.dispose();
    (this.material.uniforms["holes"]!.value as DataTexture).dispose();
    for (const points of this.pool) this.group.remove(points);
  }

  private place(placement: Placement, number: number): void {
    let points = this.pool[number];
    if (!points) {
      points = new Points(placement.tile.geometry, this.material);
      points.frustumCulled = false;
      points.matrixAutoUpdate = false;
      const self = points;
      points.onBeforeRender = () => this.setUniforms(this.placements.get(self)!);
      this.pool.push(points);
      this.group.add(points);
    }
    points.geometry = placement.tile.geometry;
    points.visible = true;
    this.placements.set(points, placement);
  }

  private setUniforms({ tile, draw, holeNode }: Placement): void {
    const { uniforms } = this.material;
    const { eye, toX, toY, toW } = this.viewpoint!;
    const { u, v, w } = tile.direction.axes;
    const set = (name: string, value: Triple): void => void (uniforms[name]!.value as Vector3).set(...value);
    set("origin", tile.originFrom(eye));
    set("toX", along(toX, u, v, w));
    set("toY", along(toY, u, v, w));
    set("toW", along(toW, u, v, w));
    set("sun", along(this.sun, u, v, w));
    uniforms["pitch"]!.value = tile.pitch;
    (uniforms["lattice"]!.value as Int32Array).set(tile.lattice);
    uniforms["holeNode"]!.value = holeNode;
    if (holeNode !== 1) {
      const { lower, size } = relativeTo(eye, draw.cell.box);
      set("cellLower", lower);
      set("cellSize", size);
      uniforms["cellLevel"]!.value = draw.cell.level;
      (uniforms["toWorld"]!.value as Matrix3).set(u[0], v[0], w[0], u[1], v[1], w[1], u[2], v[2], w[2]);
    }
    this.material.uniformsNeedUpdate = true;
  }

  private uploadTable(): void {
    const { words } = this.table;
    const rows = Math.ceil(words.length / TABLE_WIDTH);
    let texture = this.material.uniforms["holes"]!.value as DataTexture;
    if (texture.image.height < rows) {
      texture.dispose();
      texture = holeTexture(new Uint32Array(TABLE_WIDTH * rows * 2));
      this.material.uniforms["holes"]!.value = texture;
    }
    (texture.image.data as unknown as Uint32Array).set(words);
    if (words.length > 8) texture.needsUpdate = true;
  }
}

function holeTexture(words: Uint32Array): DataTexture {
  const texture = new DataTexture(words, TABLE_WIDTH, words.length / TABLE_WIDTH, RedIntegerFormat, UnsignedIntType);
  texture.internalFormat = "R32UI";
  texture.needsUpdate = true;
  return texture;
}
