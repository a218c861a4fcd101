import { cross, type Box, type Vector3 } from "../vector.js";
import { speedOf, type Prediction } from "./motion.js";

/** Parts of the time that is looked ahead while turning or moving. */
export const INTERVALS = 8;
/** Seconds that who has just come to stand is expected to stay. */
const LEAST_STAY = 1;
/** Seconds that who has just set out is expected to go on. */
const LEAST_COURSE = 5;
/** Seconds; nothing is looked ahead farther. */
const LONGEST = 120;
/** Fields of view that a turn goes on for (BEN 5.1.2). */
const TURNS = 2;
/** Times the way to the far plane that a straight line goes on for (BEN 5.1.3). */
const REACHES = 2;
/** Least distance along the view axis, as a share of a box's diagonal; behind it nothing projects. */
const NEAR = 1e-3;

/** What is expected to be seen of n objects in k intervals of time; numbers are in rows of k, one row an object. */
export interface Outlook {
  /** k + 1 seconds from the viewing on, ascending from 0; the last is the cut-off. */
  readonly bounds: readonly number[];
  /** k places of the eye, in the middle of each interval. */
  readonly eyes: readonly Vector3[];
  /** Pixels of the bounding rectangle within the picture, mean of the interval. */
  readonly visible: Float64Array;
  /** Pixels of the height of the whole rectangle; while turning of the object in the middle of the picture. */
  readonly height: Float64Array;
  readonly focal: number;
  /** Of the whole picture. */
  readonly pixels: number;
}

/** Seconds from the viewing on for which a prediction is believed. `far`: metres to the far plane. */
export function cutoff(prediction: Prediction, now: number, far: number): number {
  const { movement, viewing } = prediction;
  // The longer it has stood, the longer it will: short stops send what is quick (BEN 5.1.1).
  if (movement === "standing") return Math.min(LEAST_STAY + prediction.lasted(now), LONGEST);
  if (movement === "turning") return Math.min((TURNS * horizontal(viewing)) / Math.abs(viewing.turning), LONGEST);
  // And no longer than it has gone in this direction: from a height the far plane is minutes away.
  return Math.min((REACHES * far) / speedOf(viewing), LEAST_COURSE + prediction.lasted(now), LONGEST);
}

/**
 * What will be seen of boxes: three strategies (BEN 5.1.1 to 5.1.3); the twin of `farfield.stream.outlook.look`.
 *
 * now: seconds of the viewer's clock. far: metres to the far plane. otherwise: share of the cases in which the viewer does not do
 * what is predicted, but looks elsewhere.
 */
export function look(prediction: Prediction, boxes: readonly Box[], now: number, far: number, otherwise: number): Outlook {
  const seconds = cutoff(prediction, now, far);
  let found: Outlook;
  if (prediction.movement === "turning") found = turning(prediction, boxes, seconds);
  else if (prediction.movement === "standing") found = sampled(prediction, boxes, [0, seconds]);
  // What comes first counts for sure and is cut finest: bounds grow with the square of their number.
  else found = sampled(prediction, boxes, Array.from({ length: INTERVALS + 1 }, (_, n) => seconds * (n / INTERVALS) ** 2));
  if (otherwise > 0) mix(found, prediction, boxes, otherwise);
  return found;
}

function sampled(prediction: Prediction, boxes: readonly Box[], bounds: readonly number[]): Outlook {
  const middles = bounds.slice(1).map((end, k) => (bounds[k]! + end) / 2);
  const eyes = middles.map((at) => prediction.eye(at));
  const axes = middles.map((at) => axesOf(prediction.forward(at)));
  const { focal, size } = prediction.viewing;
  const visible = new Float64Array(boxes.length * eyes.length);
  const height = new Float64Array(visible.length);
  boxes.forEach((box, n) => {
    for (let k = 0; k < eyes.length; k++) {
      const seen = rectangleOf(box, eyes[k]!, axes[k]!, focal, size);
      visible[n * eyes.length + k] = seen.within;
      height[n * eyes.length + k] = seen.height;
    }
  });
  return { bounds, eyes, visible, height, focal, pixels: size[0] * size[1] };
}

/** Objects look the same across the picture; how much of them is in it is integrated exactly (BEN 5.1.2). */
function turning(prediction: Prediction, boxes: readonly Box[], seconds: number): Outlook {
  const { viewing } = prediction;
  const { eye, forward, focal, size } = viewing;
  const bounds = Array.from({ length: INTERVALS + 1 }, (_, n) => (seconds * n) / INTERVALS);
  const visible = new Float64Array(boxes.length * INTERVALS);
  const tall = new Float64Array(visible.length);
  const flat = Math.hypot(forward[0], forward[1]);
  const half = horizontal(viewing) / 2;
  boxes.forEach((box, n) => {
    const [x, y] = [(box.lower[0] + box.upper[0]) / 2 - eye[0], (box.lower[1] + box.upper[1]) / 2 - eye[1]];
    const across = Math.max(Math.hypot(x, y), 1e-9);
    // By a viewer of its own that has it in the middle, at the height that the viewer looks at.
    const { within, whole, height } = rectangleOf(box, eye, axesOf([(x * flat) / across, (y * flat) / across, forward[2]]), focal, size);
    const angle = around((Math.atan2(y, x) - Math.atan2(forward[1], forward[0])) * Math.sign(viewing.turning));
    const spread = Math.min(Math.max(height > 0 ? (whole / height / size[0]) * half : 0, 1e-9), Math.PI);
    // The part of the rectangle that the picture's height leaves; how wide it may be is in the share.
    const pixels = within / (spread > half ? half / spread : 1);
    tall.fill(height, n * INTERVALS, (n + 1) * INTERVALS);
    for (let k = 0; k < INTERVALS; k++) {
      const [from, to] = [Math.abs(viewing.turning) * bounds[k]!, Math.abs(viewing.turning) * bounds[k + 1]!];
      let share = 0;
      for (const round of [0, 2 * Math.PI]) share += swept(to - angle - round, spread, half) - swept(from - angle - round, spread, half);
      visible[n * INTERVALS + k] = (pixels * share) / (to - from);
    }
  });
  return { bounds, eyes: new Array<Vector3>(INTERVALS).fill(eye), visible, height: tall, focal, pixels: size[0] * size[1] };
}

/** The integral, from where an object is in the middle, of the share of it within the picture; radians. */
function swept(turned: number, spread: number, half: number): number {
  const [plateau, end] = [Math.abs(half - spread), half + spread];
  const x = Math.min(Math.abs(turned), end);
  const ramp = ((end - plateau) ** 2 - (end - Math.max(x, plateau)) ** 2) / (4 * spread);
  return Math.sign(turned) * (Math.min(1, half / spread) * Math.min(x, plateau) + ramp);
}

/** Adds a share of cases in which the viewer looks to any side from where it will be. */
function mix(found: Outlook, { viewing }: Prediction, boxes: readonly Box[], otherwise: number): void {
  const { eyes, visible, height } = found;
  const most = viewing.size[1];
  const elsewhere = (otherwise * horizontal(viewing)) / (2 * Math.PI);
  boxes.forEach(({ lower, upper }, n) => {
    const size = [upper[0] - lower[0], upper[1] - lower[1], upper[2] - lower[2]] as const;
    const radius = Math.hypot(...size) / 2;
    const share = (Math.hypot(size[0], size[1]) * size[2]) / Math.max(4 * radius ** 2, 1e-12);
    for (let k = 0; k < eyes.length; k++) {
      const eye = eyes[k]!;
      const away = Math.hypot(lower[0] + size[0] / 2 - eye[0], lower[1] + size[1] / 2 - eye[1], lower[2] + size[2] / 2 - eye[2]);
      // As a round body of its size would look in the middle of the picture.
      const across = (2 * viewing.focal * radius) / Math.max(away, radius);
      const place = n * eyes.length + k;
      visible[place] = (1 - otherwise) * visible[place]! + elsewhere * Math.min(across ** 2 * share, most ** 2);
      if (height[place] === 0) height[place] = (across * size[2]) / Math.max(2 * radius, 1e-12);
    }
  });
}

type Axes = readonly [right: Vector3, down: Vector3, forward: Vector3];

function axesOf(forward: Vector3): Axes {
  const across = cross(forward, [0, 0, 1]);
  const length = Math.hypot(...across);
  const right: Vector3 = length < 1e-9 ? [1, 0, 0] : [across[0] / length, across[1] / length, across[2] / length];
  return [right, cross(forward, right), forward];
}

/** Radians across a picture. */
function horizontal({ focal, size }: Prediction["viewing"]): number {
  return 2 * Math.atan(size[0] / 2 / focal);
}

/** An angle between -π and π. */
function around(angle: number): number {
  const turned = (angle + Math.PI) % (2 * Math.PI);
  return (turned < 0 ? turned + 2 * Math.PI : turned) - Math.PI;
}

/** Corners along right, down and forward, one after the other: bit a of a corner's number is the upper side of axis a. */
const corners = new Float64Array(24);

/**
 * The bounding rectangle of a box's projection: pixels within the picture, of all of it, and its height. What passes the eye is
 * cut off close before it.
 */
function rectangleOf(
  { lower, upper }: Box, eye: Vector3, axes: Axes, focal: number, [width, height]: readonly [number, number],
): { within: number; whole: number; height: number } {
  const near = Math.max(NEAR * Math.hypot(upper[0] - lower[0], upper[1] - lower[1], upper[2] - lower[2]), 1e-9);
  let before = 0;
  for (let corner = 0; corner < 8; corner++) {
    const x = (corner & 1 ? upper[0] : lower[0]) - eye[0];
    const y = (corner & 2 ? upper[1] : lower[1]) - eye[1];
    const z = (corner & 4 ? upper[2] : lower[2]) - eye[2];
    for (let row = 0; row < 3; row++) corners[3 * corner + row] = x * axes[row]![0] + y * axes[row]![1] + z * axes[row]![2];
    if (corners[3 * corner + 2]! >= near) before++;
  }
  if (before === 0) return { within: 0, whole: 0, height: 0 };
  let [left, right, top, bottom] = [Infinity, -Infinity, Infinity, -Infinity];
  const meet = (x: number, y: number): void => {
    [left, right, top, bottom] = [Math.min(left, x), Math.max(right, x), Math.min(top, y), Math.max(bottom, y)];
  };
  for (let corner = 0; corner < 8; corner++) {
    const [x, y, w] = [corners[3 * corner]!, corners[3 * corner + 1]!, corners[3 * corner + 2]!];
    if (w >= near) meet(x / w, y / w);
    if (before === 8) continue;
    for (let axis = 1; axis < 8; axis *= 2) {
      if (corner & axis) continue;
      const to = 3 * (corner | axis);
      const toW = corners[to + 2]!;
      if (w < near === toW < near) continue;
      const share = (near - w) / (toW - w);
      meet((x + share * (corners[to]! - x)) / near, (y + share * (corners[to + 1]! - y)) / near);
    }
  }
  const [x0, x1] = [left * focal + width / 2, right * focal + width / 2];
  const [y0, y1] = [top * focal + height / 2, bottom * focal + height / 2];
  const across = Math.max(Math.min(x1, width) - Math.max(x0, 0), 0);
  const down = Math.max(Math.min(y1, height) - Math.max(y0, 0), 0);
  return { within: across * down, whole: (x1 - x0) * (y1 - y0), height: y1 - y0 };
}
