import type { Vector3 } from "./vector.js";

/** Seconds over which the velocity is smoothed: a hand at the mouse jerks, and frames are not even. */
const SMOOTHING = 0.25;
/** Without a move for this long the eye rests. */
const REST = 0.5;

/** Follows the eye, and tells how fast it moves. */
export class Motion {
  private last: { readonly eye: Vector3; readonly at: number } | null = null;
  private velocity: Vector3 = [0, 0, 0];

  /** The eye is there, at a time in seconds. From farther away than `jump` metres it has not flown. */
  follow(eye: Vector3, at: number, jump: number): void {
    const before = this.last;
    if (before && same(before.eye, eye)) return;
    this.last = { eye, at };
    const seconds = before ? at - before.at : Infinity;
    const by = before ? minus(eye, before.eye) : eye;
    if (seconds > REST || length(by) > jump) this.velocity = [0, 0, 0];
    else if (seconds > 0) this.velocity = this.towards(by, seconds);
  }

  /** Metres a second at a time in seconds. */
  at(now: number): Vector3 {
    return this.last && now - this.last.at <= REST ? this.velocity : [0, 0, 0];
  }

  private towards(by: Vector3, seconds: number): Vector3 {
    // From rest the first step counts as a whole: else it would be taken for slower than it is.
    const share = length(this.velocity) === 0 ? 1 : 1 - Math.exp(-seconds / SMOOTHING);
    const part = (a: 0 | 1 | 2): number => this.velocity[a] + share * (by[a] / seconds - this.velocity[a]);
    return [part(0), part(1), part(2)];
  }
}

/**
 * Where the eye will be, nearest first: after an eighth, a quarter, half and all of `seconds`, as far as those are `apart`
 * metres from each other and from the eye.
 */
export function positionsAhead(eye: Vector3, velocity: Vector3, seconds: number, apart: number): Vector3[] {
  const found: Vector3[] = [];
  let reached = 0;
  for (const share of [1 / 8, 1 / 4, 1 / 2, 1]) {
    const distance = length(velocity) * seconds * share;
    if (distance - reached < apart) continue;
    reached = distance;
    const part = (a: 0 | 1 | 2): number => eye[a] + velocity[a] * seconds * share;
    found.push([part(0), part(1), part(2)]);
  }
  return found;
}

export function minus(a: Vector3, b: Vector3): Vector3 {
  return [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
}

export function length(a: Vector3): number {
  return Math.hypot(a[0], a[1], a[2]);
}

function same(a: Vector3, b: Vector3): boolean {
  return a[0] === b[0] && a[1] === b[1] && a[2] === b[2];
}
