import { BoxGeometry, Group, InstancedMesh, Mesh, MeshBasicMaterial, MeshStandardMaterial, Object3D, RawShaderMaterial } from "three";
import { describe, expect, it } from "vitest";
import { FarfieldError } from "../src/core/errors.js";
import { MOST_MOVING, MovingObjects } from "../src/three/moving.js";
import type { NearPart } from "../src/three/near/model.js";

const box = (): Mesh => new Mesh(new BoxGeometry(), new MeshStandardMaterial({ color: "#ff0000" }));

function balloon(): Group {
  const group = new Group();
  group.add(box(), box());
  return group;
}

describe("moving objects", () => {
  it("are due for a frame when they move, appear, are hidden or go, and not otherwise", () => {
    const moving = new MovingObjects();
    const object = balloon();
    expect(moving.advance()).toBe(false);
    moving.add(object);
    expect([moving.advance(), moving.advance()]).toEqual([true, false]);
    object.position.x = 5;
    expect([moving.advance(), moving.advance()]).toEqual([true, false]);
    object.children[0]!.rotation.z = 1;
    expect([moving.advance(), moving.triangles]).toEqual([true, 24]);
    object.visible = false;
    expect([moving.advance(), moving.advance(), moving.triangles]).toEqual([true, false, 0]);
    object.visible = true;
    expect(moving.advance()).toBe(true);
    moving.remove(object);
    expect([moving.advance(), moving.advance(), moving.count]).toEqual([true, false, 0]);
  });

  it("are placed relative to the eye, in double precision", () => {
    const moving = new MovingObjects();
    const object = box();
    object.position.set(1e7 + 0.25, 3, -2);
    moving.add(object);
    moving.advance();
    moving.placeFor([1e7, 1, 1]);
    const [drawn] = moving.scene.children as Mesh[];
    expect(drawn!.matrixWorld.elements.slice(12, 15)).toEqual([0.25, 2, -3]);
    expect(drawn!.geometry).toBe(object.geometry);
  });

  it("get their looks from their materials, anew when the world is drawn with others", () => {
    const moving = new MovingObjects();
    const parts: NearPart[] = [];
    const first = new Mesh(new BoxGeometry(), [new MeshBasicMaterial({ color: "#00ff00" }), new MeshStandardMaterial()]);
    moving.add(first);
    moving.drawWith((part) => (parts.push(part), new RawShaderMaterial()));
    moving.add(box());
    expect(parts.map(({ surface }) => surface.unlit)).toEqual([true, false, false]);
    expect(parts[0]!.surface.factor).toEqual([0, 1, 0, 1]);
    const [before] = moving.scene.children as Mesh[];
    const old = [before!.material].flat();
    moving.drawWith(() => new RawShaderMaterial());
    expect([before!.material].flat()).toHaveLength(2);
    expect([before!.material].flat()).not.toContain(old[0]);
    moving.dispose();
    expect([moving.scene.children.length, moving.count, first.parent]).toEqual([0, 0, null]);
  });

  it("are bounded in number, and only meshes", () => {
    const moving = new MovingObjects();
    const objects = Array.from({ length: MOST_MOVING }, box);
    for (const object of objects) moving.add(object);
    moving.add(objects[0]!);
    expect(moving.count).toBe(MOST_MOVING);
    const failing = (object: Object3D): unknown => {
      try {
        moving.add(object);
      } catch (error) {
        return (error as FarfieldError).tag;
      }
      return null;
    };
    expect(failing(box())).toBe("limit");
    moving.remove(objects[1]!);
    expect(failing(new Object3D())).toBe("unsupported");
    expect(failing(new InstancedMesh(new BoxGeometry(), new MeshBasicMaterial(), 3))).toBe("unsupported");
    expect(failing(box())).toBe(null);
  });
});
