import { length, Motion } from "../motion.js";
import type { Projection } from "../projection.js";
import { dot, type Vector3 } from "../vector.js";
import type { Viewing } from "./motion.js";

/** Seconds over which turning and acceleration are smoothed. */
const SMOOTHING = 0.25;
/** Without a turn for this long the view rests. */
const REST = 0.5;

/** Tells from one picture to the next how a viewer moves and turns. */
export class Observer {
  private readonly motion = new Motion();
  private velocity: Vector3 = [0, 0, 0];
  private acceleration: Vector3 = [0, 0, 0];
  private heading: { readonly angle: number; readonly at: number } | null = null;
  private turning = 0;
  private last = -Infinity;

  /** The picture that is seen at a time in seconds; `jump`: metres that are more than a step. */
  see(view: Projection & { readonly focal: number }, at: number, jump: number): Viewing {
    const { eye, toW, focal, width, height } = view;
    this.motion.follow(eye, at, jump);
    const velocity = this.motion.at(at);
    const forward = unit(toW);
    this.accelerate(velocity, at);
    this.turn(Math.atan2(forward[1], forward[0]), at);
    this.last = at;
    return { time: at, eye, forward, focal, size: [width, height], velocity, turning: this.turning, acceleration: this.acceleration };
  }

  private accelerate(velocity: Vector3, at: number): void {
    const seconds = at - this.last;
    const before = this.velocity;
    this.velocity = velocity;
    // From rest and to rest the eye jumps to its speed: that goes on for no longer than a picture.
    if (!(seconds > 0) || seconds > REST || length(velocity) === 0 || length(before) === 0) {
      this.acceleration = [0, 0, 0];
      return;
    }
    const share = 1 - Math.exp(-seconds / SMOOTHING);
    const part = (a: 0 | 1 | 2): number => this.acceleration[a] + share * ((velocity[a] - before[a]) / seconds - this.acceleration[a]);
    this.acceleration = [part(0), part(1), part(2)];
  }

  private turn(angle: number, at: number): void {
    const before = this.heading;
    if (!before) {
      this.heading = { angle, at };
      return;
    }
    const by = Math.atan2(Math.sin(angle - before.angle), Math.cos(angle - before.angle));
    if (by === 0) {
      if (at - before.at > REST) this.turning = 0;
      return;
    }
    const seconds = at - before.at;
    this.heading = { angle, at };
    if (!(seconds > 0) || seconds > REST) this.turning = 0;
    else this.turning += (this.turning === 0 ? 1 : 1 - Math.exp(-seconds / SMOOTHING)) * (by / seconds - this.turning);
  }
}

function unit(a: Vector3): Vector3 {
  const size = Math.sqrt(dot(a, a));
  return [a[0] / size, a[1] / size, a[2] / size];
}
