import type { Cell } from "./cell.js";
import { cut } from "./cut.js";
import type { Frustum } from "./frustum.js";
import type { Manifest } from "./manifest.js";
import { length, minus, Motion, positionsAhead } from "./motion.js";
import type { PlanView } from "./plan.js";
import type { Resource } from "./resource.js";
import type { Vector3 } from "./vector.js";
import { byUrgency, listWants, URGENCY, type Want } from "./wants.js";

/** Share of the smallest cell in use that the eye moves before it is looked ahead anew (OV 6.2). */
const REFRESH = 0.1;

/** What a world is looked ahead in. */
export interface AheadWorld {
  readonly roots: readonly Cell[];
  readonly manifest: Manifest;
  readonly lacks: (resource: Resource) => boolean;
}

/** What is found from one position. */
interface Found {
  readonly wants: readonly Want[];
  /** Cells below which the index is to be read. */
  readonly unknown: readonly Cell[];
}

/**
 * Looks ahead: what the pictures from where the eye will be have a use for. The cut of one position is made a call, so that
 * no frame does the work of all.
 */
export class LookAhead {
  /** Cells below which the index should be read. */
  unknown: readonly Cell[] = [];
  private readonly motion = new Motion();
  private positions: readonly Vector3[] = [];
  private found: (Found | null)[] = [];
  /** How many of the positions are still to be looked from, and the next of them. */
  private due = 0;
  private next = 0;
  private from: Vector3 | null = null;
  private union: readonly Want[] = [];

  /** The eye is there, at a time in seconds; `cell`: metres along the smallest cell in use. */
  follow(eye: Vector3, at: number, cell: number, seconds: number): void {
    this.motion.follow(eye, at, cell);
    const velocity = this.motion.at(at);
    const apart = REFRESH * cell;
    if (seconds === 0 || length(velocity) === 0) this.stop();
    else if (!this.from || length(minus(eye, this.from)) >= apart) this.aim(eye, positionsAhead(eye, velocity, seconds, apart));
  }

  /** Looks from the next position that is due; returns what is wanted from all, most urgent first. */
  look(world: AheadWorld, view: PlanView): readonly Want[] {
    if (this.due === 0) return this.union;
    const at = this.positions[this.next]!;
    this.found[this.next] = lookFrom(at, world, view);
    this.next = (this.next + 1) % this.positions.length;
    this.due--;
    const known = this.found.filter((found) => found !== null);
    this.union = joinWants(known.map(({ wants }) => wants));
    this.unknown = [...new Set(known.flatMap(({ unknown }) => unknown))];
    return this.union;
  }

  private aim(eye: Vector3, positions: readonly Vector3[]): void {
    if (positions.length === 0) return this.stop();
    if (positions.length !== this.positions.length) {
      this.found = positions.map(() => null);
      this.next = 0;
    }
    this.positions = positions;
    this.due = positions.length;
    this.from = eye;
  }

  private stop(): void {
    this.positions = this.found = [];
    this.union = this.unknown = [];
    this.due = 0;
    this.from = null;
  }
}

/** What the picture from a position has a use for, ordered by the distance from where the eye is now. */
function lookFrom(at: Vector3, { roots, manifest, lacks }: AheadWorld, view: PlanView): Found {
  const there = { ...view, eye: at, frustum: shifted(view.frustum, minus(at, view.eye)) };
  const found = cut(roots, at, view.radius, view.near);
  const wants = listWants(roots, { cut: found }, manifest, there, lacks, view.eye)
    .filter(({ urgency }) => urgency === URGENCY.seen || urgency === URGENCY.detail)
    .map((want) => ({ ...want, urgency: URGENCY.ahead }));
  return { wants, unknown: found.unknown };
}

function shifted(frustum: Frustum, by: Vector3): Frustum {
  return frustum.map(({ normal, offset }) => ({
    normal,
    offset: offset - normal[0] * by[0] - normal[1] * by[1] - normal[2] * by[2],
  }));
}

/** Several lists as one, most urgent first, each value once: as urgent as the most urgent of them says. */
export function joinWants(lists: readonly (readonly Want[])[]): readonly Want[] {
  const full = lists.filter((list) => list.length > 0);
  if (full.length <= 1) return full[0] ?? [];
  const best = new Map<Resource, Want>();
  for (const want of full.flat()) {
    const known = best.get(want.resource);
    if (!known || byUrgency(want, known) < 0) best.set(want.resource, want);
  }
  return [...best.values()].sort(byUrgency);
}
