import type { Group } from "three";
import type { PlacedMesh } from "../../core/instances.js";
import type { InstancesDraw } from "../../core/plan.js";
import { distanceTo, type Vector3 } from "../../core/vector.js";
import { InstancedModel } from "./instances.js";
import type { NearMaterials } from "./materials.js";
import type { NearModel } from "./model.js";

/** Instances as they are drawn: of a mesh in a form that is held of it, or one by an image of it. */
interface Drawn {
  readonly placed: PlacedMesh;
  readonly model: NearModel;
}

/** Draws instances whole and by themselves, as the index places them, where their leaves are not there. */
export class PlacedInstances {
  private readonly models = new Map<NearModel, InstancedModel>();
  private drawn: readonly Drawn[] = [];

  constructor(
    private readonly group: Group,
    private readonly materials: NearMaterials,
  ) {}

  /** Takes what is to be drawn, as seen from an eye. */
  set(draws: readonly InstancesDraw[], eye: Vector3): void {
    const drawn = draws.map(({ placed, form }) => ({ placed, model: form.mesh.payload as NearModel }));
    if (!areSame(drawn, this.drawn)) this.change(drawn, eye);
    for (const model of this.models.values()) model.moveTo(eye);
  }

  /** Triangles drawn last. */
  get triangles(): number {
    let sum = 0;
    for (const { count, triangles } of this.models.values()) sum += count * triangles;
    return sum;
  }

  /** Forgets a model that is about to be dropped. */
  forget(model: NearModel): void {
    this.models.get(model)?.dispose();
    this.models.delete(model);
    this.drawn = this.drawn.filter((one) => one.model !== model);
  }

  dispose(): void {
    for (const model of [...this.models.keys()]) this.forget(model);
  }

  private change(drawn: readonly Drawn[], eye: Vector3): void {
    this.drawn = drawn;
    const anchor = anchorOf(drawn, eye);
    const placed = new Map<NearModel, PlacedMesh[]>([...this.models.keys()].map((model) => [model, []]));
    for (const one of drawn) {
      const own = placed.get(one.model);
      if (own) own.push(one.placed);
      else placed.set(one.model, [one.placed]);
    }
    for (const [model, own] of placed) this.instanced(model).put(transformsOf(own, anchor), anchor);
  }

  private instanced(model: NearModel): InstancedModel {
    const found = this.models.get(model) ?? new InstancedModel(this.group, model, (part) => this.materials.make(part, "placed"));
    this.models.set(model, found);
    return found;
  }
}

function areSame(a: readonly Drawn[], b: readonly Drawn[]): boolean {
  return a.length === b.length && a.every(({ placed, model }, n) => placed === b[n]!.placed && model === b[n]!.model);
}

/** The corner of the leaf that has the nearest of them: instances keep their precision relative to it. */
function anchorOf(drawn: readonly Drawn[], eye: Vector3): Vector3 {
  let [anchor, least] = [eye, Infinity];
  for (const { placed: { corner, bounds } } of drawn) {
    const away = distanceTo(bounds, eye);
    if (away < least) [anchor, least] = [corner, away];
  }
  return anchor;
}

function transformsOf(placed: readonly PlacedMesh[], anchor: Vector3): Float32Array {
  const count = placed.reduce((sum, { instances }) => sum + instances.length, 0);
  const all = new Float32Array(16 * count);
  let at = 0;
  for (const { corner, instances } of placed) {
    for (const { transform } of instances) {
      all.set(transform, at);
      for (let a = 0; a < 3; a++) all[at + 12 + a] = transform[12 + a]! + corner[a]! - anchor[a]!;
      at += 16;
    }
  }
  return all;
}
