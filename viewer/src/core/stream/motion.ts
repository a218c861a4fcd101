import { dot, type Vector3 } from "../vector.js";

/** Seconds of directions that a curve is averaged over. */
const MEAN_OVER = 1;
/** Seconds for which an acceleration is believed. */
const ACCELERATES = 1;
/** From this angle on another direction is another course: its cosine. */
const TURNED = Math.cos(Math.PI / 6);
/** A viewer moves from this many metres or radians a second on. */
const STILL = 1e-3;

/** A viewer at a moment, as it says of itself. */
export interface Viewing {
  /** Seconds, of any clock that goes on evenly. */
  readonly time: number;
  /** Local metres. */
  readonly eye: Vector3;
  /** Unit vector. */
  readonly forward: Vector3;
  /** Pixels of one unit at distance one. */
  readonly focal: number;
  /** Width and height of the picture, pixels. */
  readonly size: readonly [number, number];
  /** Metres a second. */
  readonly velocity: Vector3;
  /** Radians a second about the vertical, counter-clockwise from above. */
  readonly turning: number;
  /** Metres a second squared. */
  readonly acceleration: Vector3;
}

export type Movement = "standing" | "turning" | "straight";

/** What a viewer is expected to do from a moment on; the twin of `farfield.stream.motion.Prediction`. */
export class Prediction {
  constructor(
    readonly movement: Movement,
    readonly viewing: Viewing,
    /** When it began to move this way, and in about this direction, seconds of its clock. */
    readonly since: number,
  ) {}

  /** Seconds for which it has moved this way. */
  lasted(now: number): number {
    return Math.max(now - this.since, 0);
  }

  /** Local metres, so many seconds after the viewing. */
  eye(seconds: number): Vector3 {
    const { eye, velocity, acceleration } = this.viewing;
    if (this.movement !== "straight") return eye;
    const speeding = Math.min(seconds, this.accelerates);
    const part = (a: 0 | 1 | 2): number => eye[a] + velocity[a] * seconds + acceleration[a] * speeding * (seconds - speeding / 2);
    return [part(0), part(1), part(2)];
  }

  /** Unit vector, so many seconds after the viewing. */
  forward(seconds: number): Vector3 {
    const { forward, turning } = this.viewing;
    if (this.movement !== "turning") return forward;
    const [cos, sin] = [Math.cos(turning * seconds), Math.sin(turning * seconds)];
    return [cos * forward[0] - sin * forward[1], sin * forward[0] + cos * forward[1], forward[2]];
  }

  /** Seconds for which the acceleration is believed: less when it would stop the viewer before. */
  private get accelerates(): number {
    const { velocity, acceleration } = this.viewing;
    const slowing = -(velocity[0] * acceleration[0] + velocity[1] * acceleration[1] + velocity[2] * acceleration[2]);
    return slowing <= 0 ? ACCELERATES : Math.min(ACCELERATES, speedOf(this.viewing) ** 2 / slowing);
  }
}

/** Follows a viewer and predicts it: what it does now goes on for a while (BEN 5.1). Times ascend. */
export class MotionPredictor {
  prediction: Prediction | null = null;
  private seen: Viewing[] = [];
  private course: Vector3 = [0, 0, 0];

  /** Takes what a viewer says of itself; what is older than what it said before is passed over. */
  follow(viewing: Viewing): Prediction {
    const before = this.prediction;
    if (before && viewing.time <= before.viewing.time) return before;
    this.seen = [...this.seen.filter(({ time }) => time >= viewing.time - MEAN_OVER), viewing];
    const movement = speedOf(viewing) > STILL ? "straight" : Math.abs(viewing.turning) > STILL ? "turning" : "standing";
    const goes = movement === "straight" ? this.straightened(viewing) : viewing;
    if (before?.movement === movement && !(movement === "straight" && this.isOff(goes))) {
      this.prediction = new Prediction(movement, goes, before.since);
    } else {
      this.prediction = new Prediction(movement, goes, viewing.time);
      this.course = goes.velocity;
    }
    return this.prediction;
  }

  /** Whether a line goes in another direction than when it began. */
  private isOff(goes: Viewing): boolean {
    return dot(goes.velocity, this.course) < TURNED * speedOf(goes) * Math.hypot(...this.course);
  }

  /** A curve's velocity in the mean direction of the last second, as fast as now. */
  private straightened(viewing: Viewing): Viewing {
    const moving = this.seen.filter((one) => speedOf(one) > STILL);
    const mean = (a: 0 | 1 | 2): number => moving.reduce((sum, one) => sum + one.velocity[a] / speedOf(one), 0) / moving.length;
    const direction: Vector3 = [mean(0), mean(1), mean(2)];
    const length = Math.hypot(...direction);
    // It turned round within the second: what it does now counts.
    if (length < 0.5) return viewing;
    const times = speedOf(viewing) / length;
    return { ...viewing, velocity: [direction[0] * times, direction[1] * times, direction[2] * times] };
  }
}

export function speedOf({ velocity }: Viewing): number {
  return Math.hypot(velocity[0], velocity[1], velocity[2]);
}
