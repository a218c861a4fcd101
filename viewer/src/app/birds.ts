import { BufferAttribute, BufferGeometry, DoubleSide, Group, Mesh, MeshStandardMaterial, type Object3D } from "three";
import type { Vector3 } from "../core/vector.js";

/** An object on its way. */
export interface Flyer {
  readonly object: Object3D;
  /** Puts it where it is at a time, seconds. */
  move(time: number): void;
}

const BIRDS = 9;

/** Birds in a wedge on one wide circle, beating their wings. */
export function flockOf([x, y, z]: Vector3, reach: number): Flyer[] {
  const size = 0.008 * reach;
  return Array.from({ length: BIRDS }, (_, n) => {
    const object = new Group();
    object.name = `bird ${n + 1}`;
    const [left, right] = [wing(1), wing(-1)];
    object.add(left, right);
    object.scale.setScalar(size);
    const [behind, beside] = [2.2 * Math.ceil(n / 2) * size, 1.8 * Math.ceil(n / 2) * (n % 2 ? 1 : -1) * size];
    const radius = 0.42 * reach + beside;
    const move = (time: number): void => {
      const turn = -(0.06 * time - behind / radius);
      object.position.set(x + radius * Math.cos(turn), y + radius * Math.sin(turn), z + 0.16 * reach + 0.4 * size * Math.sin(time + n));
      object.rotation.z = turn - Math.PI / 2;
      left.rotation.x = 0.5 * Math.sin(5 * time + 0.9 * n) + 0.15;
      right.rotation.x = -left.rotation.x;
    };
    return { object, move };
  });
}

/** Half a bird, which flies along x. */
function wing(side: 1 | -1): Mesh {
  const geometry = new BufferGeometry();
  const points = [0.45, 0, 0, -0.35, 0, 0, 0.1, 0.7 * side, 0.05, 0.1, 0.7 * side, 0.05, -0.35, 0, 0, -0.25, 1.3 * side, 0];
  geometry.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
  geometry.computeVertexNormals();
  return new Mesh(geometry, new MeshStandardMaterial({ color: "#2b2f36", side: DoubleSide }));
}
