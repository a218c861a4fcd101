import {
  BoxGeometry, BufferAttribute, Color, CylinderGeometry, DoubleSide, Group, LatheGeometry, Mesh, MeshStandardMaterial, Vector2,
  type Object3D,
} from "three";
import type { Vector3 } from "../core/vector.js";
import { flockOf, type Flyer } from "./birds.js";
import { aimOf, type Pose } from "./pose.js";

/** Where moving objects are shown. */
export interface Stage {
  addMoving(object: Object3D): void;
  removeMoving(object: Object3D): void;
}

const PALETTES = [
  ["#c8102e", "#f6d55c"], ["#1d4e89", "#f4f1de"], ["#2a9d8f", "#e9c46a"], ["#6a0572", "#f7a072"], ["#e76f51", "#264653"], ["#f4f1de", "#d1495b"],
] as const;
/** Width and height of half a balloon's outline, from its mouth up; its greatest width is 1. */
const OUTLINE = [
  [0.16, 0], [0.2, 0.08], [0.34, 0.3], [0.52, 0.58], [0.68, 0.86], [0.8, 1.14], [0.9, 1.42], [0.98, 1.74], [1, 2], [0.97, 2.26], [0.88, 2.52], [0.72, 2.76],
  [0.5, 2.94], [0.26, 3.04], [0, 3.08],
] as const;
const GORES = 24;

/** Balloons that drift, and a flock of birds, round the target of a pose: sizes and ways go by its distance. */
export class Balloons {
  private readonly flyers: readonly Flyer[];
  private shown = false;

  constructor(
    private readonly stage: Stage,
    home: Pose,
  ) {
    const reach = aimOf(home).distance;
    const balloons = PALETTES.map((colors, n) => balloonOf(colors, n, home.target, reach));
    this.flyers = [...balloons, ...flockOf(home.target, reach)];
  }

  get visible(): boolean {
    return this.shown;
  }

  set visible(visible: boolean) {
    if (visible === this.shown) return;
    this.shown = visible;
    for (const { object } of this.flyers) {
      if (visible) this.stage.addMoving(object);
      else this.stage.removeMoving(object);
    }
  }

  /** Moves everything on; `now` in milliseconds. */
  advance(now: number): void {
    if (this.shown) for (const flyer of this.flyers) flyer.move(now / 1000);
  }
}

/** Each on a circle of its own, rising and sinking, slowly turning. */
function balloonOf(colors: readonly [string, string], n: number, [x, y, z]: Vector3, reach: number): Flyer {
  const object = new Group();
  object.name = `balloon ${n + 1}`;
  object.add(envelope(colors), basket(), ...ropes());
  object.scale.setScalar(reach * (0.014 + 0.004 * (n % 3)));
  const radius = reach * (0.1 + 0.07 * n);
  const move = (time: number): void => {
    const turn = 2.4 * n + (0.012 * reach * time) / radius;
    const height = reach * (0.07 + 0.035 * ((n * 2) % 5)) + 0.015 * reach * Math.sin(0.21 * time + 1.7 * n);
    object.position.set(x + radius * Math.cos(turn), y + radius * Math.sin(turn), z + height);
    object.rotation.z = 0.1 * time + n;
  };
  return { object, move };
}

function envelope([first, second]: readonly [string, string]): Mesh {
  const geometry = new LatheGeometry(OUTLINE.map(([width, height]) => new Vector2(width, height)), GORES);
  geometry.rotateX(Math.PI / 2);
  // Every gore has its own corners, so that the stripes are sharp.
  const flat = geometry.toNonIndexed();
  const { position } = flat.attributes as { position: BufferAttribute };
  const colors = new Float32Array(position.count * 3);
  for (let corner = 0; corner < position.count; corner += 3) {
    const middle = [0, 1, 2].map((k) => [position.getX(corner + k), position.getY(corner + k)]);
    const [x, y] = [0, 1].map((a) => middle.reduce((sum, at) => sum + at[a]!, 0));
    const gore = Math.floor(((Math.atan2(y!, x!) / (2 * Math.PI) + 1) * GORES) / 3);
    const color = new Color(gore % 2 ? first : second);
    for (let k = 0; k < 3; k++) color.toArray(colors, (corner + k) * 3);
  }
  flat.setAttribute("color", new BufferAttribute(colors, 3));
  return new Mesh(flat, new MeshStandardMaterial({ vertexColors: true, side: DoubleSide }));
}

function basket(): Mesh {
  const mesh = new Mesh(new BoxGeometry(0.34, 0.34, 0.28), new MeshStandardMaterial({ color: "#8a5a2b" }));
  mesh.position.z = -0.72;
  return mesh;
}

function ropes(): Mesh[] {
  return [[-1, -1], [-1, 1], [1, -1], [1, 1]].map(([x, y]) => {
    const mesh = new Mesh(new CylinderGeometry(0.012, 0.012, 0.62, 5), new MeshStandardMaterial({ color: "#3b3024" }));
    mesh.rotation.x = Math.PI / 2;
    mesh.position.set(0.15 * x!, 0.15 * y!, -0.28);
    return mesh;
  });
}
