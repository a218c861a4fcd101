import { BoxGeometry, Group, Matrix4, RawShaderMaterial, Vector3 as Three, type InstancedMesh } from "three";
import { describe, expect, it } from "vitest";
import type { InstancedMesh as Listed } from "../src/core/indextile.js";
import { meshForm, placedMesh } from "../src/core/instances.js";
import type { InstancesDraw } from "../src/core/plan.js";
import { Resource } from "../src/core/resource.js";
import type { Vector3 } from "../src/core/vector.js";
import type { NearMaterials } from "../src/three/near/materials.js";
import type { NearModel } from "../src/three/near/model.js";
import { PlacedInstances } from "../src/three/near/placed.js";

const surface = { map: null, factor: [1, 1, 1, 1], cutoff: 0, unlit: false, colored: false } as const;
const part = () => ({ geometry: new BoxGeometry(), surface, triangles: 12, features: 0 });
const modelOf = (parts: number): NearModel => ({ parts: Array.from({ length: parts }, part), placements: [], objects: null, bytes: 0, dispose: () => undefined });
/** x to y, y to -x, and so far from the corner. */
const turned = (x: number): number[] => [0, -1, 0, x, 1, 0, 0, 2, 0, 0, 1, 3];

/** Instances of a mesh in a leaf with that corner, to be drawn by a model. */
function draw(model: NearModel, corner: Vector3, ...places: number[]): InstancesDraw {
  const mesh = Object.assign(new Resource("mesh/1", "mesh", 10, null), { payload: model });
  const listed: Listed = {
    bounds: [[0, 0, 0], [1, 1, 1]], levels: [{ hash: "1", bytes: 10, triangles: 12 }],
    objects: places, transforms: places.map(turned),
  };
  const placed = placedMesh(listed, corner, { forms: [meshForm(listed.levels[0]!, 0, mesh)], impostors: [] });
  return { placed, form: placed.forms[0]! };
}

function makeGroup() {
  const group = new Group();
  const kinds: string[] = [];
  const make: NearMaterials["make"] = (_, kind) => {
    kinds.push(kind);
    return new RawShaderMaterial();
  };
  const placed = new PlacedInstances(group, { make } as NearMaterials);
  const meshes = (): InstancedMesh[] => group.children as InstancedMesh[];
  /** Where the mesh's point (1, 0, 0) of an instance is, from the eye. */
  const pointOf = (mesh: InstancedMesh, n: number): number[] => {
    const matrix = new Matrix4();
    mesh.getMatrixAt(n, matrix);
    return new Three(1, 0, 0).applyMatrix4(matrix).applyMatrix4(mesh.matrixWorld).toArray();
  };
  return { placed, kinds, meshes, pointOf };
}

describe("placed instances", () => {
  it("are a draw call for each part of a mesh, relative to the eye wherever that is", () => {
    const { placed, kinds, meshes, pointOf } = makeGroup();
    const model = modelOf(2);
    const draws = [draw(model, [3e6, -2e6, 0], 0.25, 4.5), draw(model, [3e6 + 8, -2e6, 0], 1.125)];
    placed.set(draws, [3e6 + 0.5, -2e6 - 1, 1]);
    expect(kinds).toEqual(["placed", "placed"]);
    expect(meshes().map(({ count, visible }) => [count, visible])).toEqual([[3, true], [3, true]]);
    expect([0, 1, 2].map((n) => pointOf(meshes()[1]!, n))).toEqual([[-0.25, 4, 2], [4, 4, 2], [8.625, 4, 2]]);
    expect(placed.triangles).toBe(3 * 24);
    placed.set(draws, [3e6 + 1.5, -2e6, 1]);
    expect(pointOf(meshes()[0]!, 0)).toEqual([-1.25, 3, 2]);
  });

  it("change with what is drawn, and go with their model", () => {
    const { placed, meshes } = makeGroup();
    const [model, other] = [modelOf(1), modelOf(1)];
    const draws = [draw(model, [0, 0, 0], 1, 2), draw(other, [0, 0, 0], 1)];
    placed.set(draws, [0, 0, 0]);
    const uploaded = (): number[] => meshes().map(({ instanceMatrix }) => instanceMatrix.version);
    const before = uploaded();
    placed.set(draws, [5, 0, 0]);
    expect(uploaded()).toEqual(before);
    placed.set(draws.slice(0, 1), [5, 0, 0]);
    expect(meshes().map(({ visible }) => visible)).toEqual([true, false]);
    expect(placed.triangles).toBe(24);
    placed.forget(model);
    expect(meshes()).toHaveLength(1);
    const again = modelOf(1);
    draws[0]!.form.mesh.payload = again;
    placed.set(draws, [5, 0, 0]);
    expect(meshes().map(({ count }) => count)).toEqual([1, 2]);
    placed.dispose();
    expect(meshes()).toEqual([]);
  });
});
