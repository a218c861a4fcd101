import {
  BackSide, BufferAttribute, DynamicDrawUsage, GLSL3, GreaterDepth, InstancedBufferGeometry, InstancedInterleavedBuffer,
  InterleavedBufferAttribute, Mesh, NoBlending, RawShaderMaterial, type IUniform,
} from "three";
import type { BlockMapPage } from "./blockmappage.js";
import commonText from "./shaders/blockmap.glsl";
import fragmentText from "./shaders/blockmap.frag.glsl";
import vertexText from "./shaders/blockmap.vert.glsl";
import holesText from "./shaders/holes.glsl";
import lightText from "./shaders/light.glsl";

const PRECISION = "precision highp float;\nprecision highp int;\n";
/** As blockmap.vert.glsl has them, four numbers each. */
const ATTRIBUTES = ["place", "form", "looks", "walls"];
/** Numbers of a box. */
export const STRIDE = 4 * ATTRIBUTES.length;
/** Corners of the unit cube, x fastest; and its sides, two triangles each, counter-clockwise from outside. */
const CORNERS = [0, 1, 2, 3, 4, 5, 6, 7].flatMap((n) => [n & 1, (n >> 1) & 1, n >> 2]);
const SIDES = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/** Boxes of maps of one page, drawn in one call. */
export class BlockMapBoxes {
  readonly mesh: Mesh<InstancedBufferGeometry, RawShaderMaterial>;
  private readonly instances: InstancedInterleavedBuffer;

  /** shared: uniforms; own: those of the holes that the maps are drawn for, or none. */
  constructor(capacity: number, shared: Record<string, IUniform>, own: Record<string, IUniform> | null) {
    this.instances = new InstancedInterleavedBuffer(new Float32Array(STRIDE * capacity), STRIDE);
    this.instances.setUsage(DynamicDrawUsage);
    const geometry = new InstancedBufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(Float32Array.from(CORNERS), 3));
    geometry.setIndex(SIDES.flatMap(([a, b, c, d]) => [a!, b!, c!, a!, c!, d!]));
    ATTRIBUTES.forEach((name, n) => geometry.setAttribute(name, new InterleavedBufferAttribute(this.instances, 4, 4 * n)));
    this.mesh = new Mesh(geometry, materialOf({ ...shared, ...own, maps: { value: null }, texels: { value: 0 } }, own !== null));
    this.mesh.frustumCulled = false;
    this.mesh.matrixAutoUpdate = this.mesh.matrixWorldAutoUpdate = false;
    this.clear();
  }

  get count(): number {
    return this.mesh.geometry.instanceCount;
  }

  /** Takes all boxes out, and lets go of their page, which may be dropped before there are others. */
  clear(): void {
    this.mesh.material.uniforms["maps"]!.value = null;
    this.mesh.geometry.instanceCount = 0;
    this.mesh.visible = false;
  }

  /** Adds a box, of STRIDE numbers. */
  add({ texture, n }: BlockMapPage, numbers: readonly number[]): void {
    const { uniforms } = this.mesh.material;
    uniforms["maps"]!.value = texture;
    uniforms["texels"]!.value = n;
    (this.instances.array as Float32Array).set(numbers, STRIDE * this.count);
    this.instances.needsUpdate = true;
    this.mesh.geometry.instanceCount++;
    this.mesh.visible = true;
  }

  dispose(): void {
    this.mesh.removeFromParent();
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }
}

function materialOf(uniforms: Record<string, IUniform>, withHoles: boolean): RawShaderMaterial {
  return new RawShaderMaterial({
    name: "farfield blockmaps",
    glslVersion: GLSL3,
    defines: withHoles ? { HOLES: "" } : {},
    vertexShader: [PRECISION, commonText, vertexText].join("\n"),
    fragmentShader: [PRECISION, lightText, ...(withHoles ? [holesText] : []), commonText, fragmentText].join("\n"),
    side: BackSide,
    depthFunc: GreaterDepth,
    blending: NoBlending,
    uniforms,
  });
}
