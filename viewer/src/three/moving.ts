import {
  Group, Matrix4, Mesh, Scene, type BatchedMesh, type BufferGeometry, type InstancedMesh, type Material, type Object3D,
  type RawShaderMaterial, type SkinnedMesh,
} from "three";
import { FarfieldError } from "../core/errors.js";
import type { Vector3 } from "../core/vector.js";
import { surfaceOf } from "./near/parse.js";
import type { NearPart } from "./near/model.js";

/** Moving objects of a world, at most: each is drawn anew with every frame. */
export const MOST_MOVING = 64;

/** Makes what a part is drawn with, lit as the world's near geometry. */
export type MaterialMaker = (part: NearPart) => RawShaderMaterial;

interface Part {
  readonly source: Mesh<BufferGeometry, Material | Material[]>;
  readonly drawn: Mesh<BufferGeometry, RawShaderMaterial | RawShaderMaterial[]>;
  /** Where it was when it was drawn last; null: nowhere. */
  place: Matrix4 | null;
}

/** Objects that move about in a world: a bounded number, drawn as geometry over the picture of everything else. */
export class MovingObjects {
  /** What is drawn: parts, relative to the eye. */
  readonly scene = new Scene();
  private readonly holder = new Group();
  private readonly parts = new Map<Object3D, Part[]>();
  private make: MaterialMaker | null = null;
  private changed = false;

  constructor() {
    this.scene.matrixWorldAutoUpdate = false;
  }

  get count(): number {
    return this.parts.size;
  }

  /** Triangles of those that are visible. */
  get triangles(): number {
    let sum = 0;
    for (const { source, place } of [...this.parts.values()].flat()) if (place) sum += trianglesOf(source.geometry);
    return sum;
  }

  /** Takes an object in; throws `limit` when there are enough, `unsupported` for what cannot be drawn. */
  add(object: Object3D): void {
    if (this.parts.has(object)) return;
    if (this.count === MOST_MOVING) {
      throw new FarfieldError("limit", `a world has at most ${MOST_MOVING} moving objects`, object.name, "remove one, or join several into one");
    }
    const meshes = meshesOf(object);
    this.holder.add(object);
    this.parts.set(object, meshes.map((source) => ({ source, drawn: new Mesh(source.geometry, []), place: null })));
    for (const part of this.parts.get(object)!) this.prepare(part);
    this.changed = true;
  }

  remove(object: Object3D): void {
    for (const { drawn } of this.parts.get(object) ?? []) {
      this.scene.remove(drawn);
      for (const material of [drawn.material].flat()) material.dispose();
    }
    if (!this.parts.delete(object)) return;
    this.holder.remove(object);
    this.changed = true;
  }

  /** Uses what the world is drawn with from now on. */
  drawWith(make: MaterialMaker): void {
    this.make = make;
    for (const part of [...this.parts.values()].flat()) this.dress(part);
  }

  /** Looks where the objects are; returns whether a new frame is due. */
  advance(): boolean {
    if (this.count > 0) this.holder.updateMatrixWorld();
    let { changed } = this;
    this.changed = false;
    for (const part of [...this.parts.values()].flat()) changed = move(part) || changed;
    return changed;
  }

  /** Puts everything where it is seen from an eye, local metres. */
  placeFor([x, y, z]: Vector3): void {
    const toEye = new Matrix4().makeTranslation(-x, -y, -z);
    for (const { drawn, place } of [...this.parts.values()].flat()) {
      drawn.visible = place !== null;
      if (place) drawn.matrixWorld.multiplyMatrices(toEye, place);
    }
  }

  dispose(): void {
    for (const object of [...this.parts.keys()]) this.remove(object);
  }

  private prepare(part: Part): void {
    part.drawn.frustumCulled = false;
    part.drawn.matrixAutoUpdate = part.drawn.matrixWorldAutoUpdate = false;
    this.scene.add(part.drawn);
    this.dress(part);
  }

  private dress({ source, drawn }: Part): void {
    const { make } = this;
    if (!make) return;
    const { geometry, material } = source;
    const made = (one: Material): RawShaderMaterial => make({ geometry, surface: surfaceOf(one, geometry), triangles: trianglesOf(geometry), features: 0 });
    for (const old of [drawn.material].flat()) old.dispose();
    drawn.material = Array.isArray(material) ? material.map(made) : made(material);
  }
}

/** Notes where a part is; returns whether that is elsewhere than before. */
function move(part: Part): boolean {
  const { source, place } = part;
  if (!isVisible(source)) {
    part.place = null;
    return place !== null;
  }
  if (place?.equals(source.matrixWorld)) return false;
  part.place = (place ?? new Matrix4()).copy(source.matrixWorld);
  return true;
}

function isVisible(object: Object3D): boolean {
  for (let at: Object3D | null = object; at; at = at.parent) if (!at.visible) return false;
  return true;
}

function trianglesOf(geometry: BufferGeometry): number {
  return (geometry.index ?? geometry.getAttribute("position")).count / 3;
}

/** Throws `unsupported` when there is none, or one of a kind that is not drawn. */
function meshesOf(object: Object3D): Part["source"][] {
  const meshes: Part["source"][] = [];
  object.traverse((part) => {
    if (!(part as Mesh).isMesh) return;
    const { isSkinnedMesh, isInstancedMesh, isBatchedMesh } = part as Partial<SkinnedMesh & InstancedMesh & BatchedMesh>;
    if (isSkinnedMesh || isInstancedMesh || isBatchedMesh) {
      throw new FarfieldError("unsupported", `a moving object with a ${part.type}`, part.name, "plain meshes are drawn");
    }
    meshes.push(part as Part["source"]);
  });
  if (meshes.length === 0) throw new FarfieldError("unsupported", "a moving object without a mesh", object.name, "meshes are drawn");
  return meshes;
}
