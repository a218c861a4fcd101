import type { Cell } from "../cell.js";
import { seesBox, type Frustum } from "../frustum.js";
import type { Resource } from "../resource.js";
import type { Sizes } from "../sizes.js";
import { distanceTo, farthestIn, type Vector3 } from "../vector.js";
import { byUrgency, isNeeded, URGENCY, type Want } from "../wants.js";
import type { Link } from "./link.js";
import type { Viewing } from "./motion.js";
import { Pictures, type CellsView, type Part } from "./pictures.js";
import { Scheduler } from "./scheduler.js";

/** Share of the cache up to which what stands in is fetched for the picture: then it and the picture fit together. */
const ROOM_TO_STAND_IN = 0.7;
/** Seconds for which an order holds, and how many are put in order: more would not be asked for before the next. */
const HOLDS_SECONDS = 0.1;
const RANKED = 128;

/** What a ranking is made for. */
export interface RankedView extends CellsView {
  readonly eye: Vector3;
  readonly frustum: Frustum;
}

/** Puts what is wanted in the order in which it adds most to the pictures to come for the time that it takes (BEN 5). */
export class Ranking {
  private view: RankedView | null = null;
  private ranked: ReadonlyMap<Resource, Want> = new Map();
  /** Cells whose geometry comes in place of their pictures. */
  private replaced: ReadonlySet<Cell | null> = new Set();
  private rankedAt = -Infinity;
  private readonly pictures = new Pictures(() => this.view!);
  private readonly scheduler: Scheduler<Part>;

  constructor(link: Link, private readonly sizes: Sizes) {
    this.scheduler = new Scheduler(this.pictures, () => this.far(), () => link);
  }

  /** More of the index is known: the next order is a new one. */
  forget(): void {
    this.rankedAt = -Infinity;
  }

  /** Cells below which the index is to be read, too; see Pictures. */
  get unknown(): readonly Cell[] {
    return this.pictures.unknown;
  }

  /** The same wants and, where they help before those do, what can stand in for them. `budget`: bytes of the cache. */
  rank(wants: readonly Want[], view: RankedView, viewing: Viewing, budget: number): Want[] {
    this.view = view;
    if (viewing.time >= this.rankedAt + HOLDS_SECONDS || viewing.time < this.rankedAt || this.isSpent(wants)) this.choose(viewing);
    const { ranked } = this;
    const known = new Map(wants.map((want) => [want.resource, want]));
    const needed = [...wants, ...ranked.values()].filter(({ urgency }) => isNeeded(urgency));
    const bytes = [...new Set(needed.map(({ resource }) => resource))].reduce((sum, resource) => sum + this.sizes.of(resource), 0);
    const fits = bytes <= budget * ROOM_TO_STAND_IN;
    const found = wants.filter(({ resource }) => ranked.has(resource) || resource.kind !== "orthoview" || !this.replaced.has(resource.cell)).map((want) => {
      const own = ranked.get(want.resource);
      if (isNeeded(want.urgency)) return { ...want, urgency: URGENCY.seen, ...(own && { rank: own.rank! }) };
      return own && (fits || !isNeeded(own.urgency)) && own.urgency <= want.urgency ? own : want;
    });
    if (fits) for (const want of ranked.values()) if (!known.has(want.resource) && !want.resource.held) found.push(want);
    return found.sort(byUrgency);
  }

  /** Whether all that was in order has come, or the picture waits for what never was: nothing might happen any more that makes an order. */
  private isSpent(wants: readonly Want[]): boolean {
    const isWaiting = (): boolean => wants.some(({ urgency, resource }) => isNeeded(urgency) && resource.state === "absent");
    const hasCome = [...this.ranked.keys()].every(({ state }) => state !== "absent" && state !== "loading");
    return hasCome && (this.ranked.size > 0 || isWaiting());
  }

  private choose(viewing: Viewing): void {
    this.rankedAt = viewing.time;
    this.scheduler.follow(viewing, viewing.time);
    const ranked = new Map<Resource, Want>();
    const replaced = new Set<Cell | null>();
    // What is under way is chosen no more, and is wanted as long as it is of use: given up and asked for anew it would come later.
    // And a server may have chosen it.
    for (const part of [...this.pictures.coming, ...this.scheduler.order(viewing.time, RANKED).map(({ offer }) => offer.item)]) {
      this.enlist(part, ranked);
      for (const cell of part.cells) if (distanceTo(cell.box, viewing.eye) >= this.view!.near) replaced.add(cell);
    }
    this.ranked = ranked;
    this.replaced = replaced;
  }

  private enlist({ cell, resources }: Part, ranked: Map<Resource, Want>): void {
    const urgency = this.urgencyOf(cell);
    for (const resource of resources) {
      if (!ranked.has(resource)) ranked.set(resource, { resource, urgency, rank: ranked.size, distance: 0, level: cell.level });
    }
  }

  private urgencyOf({ reach }: Cell): number {
    return seesBox(this.view!.frustum, reach) ? URGENCY.seen : URGENCY.ahead;
  }

  private far(): number {
    const { roots, eye } = this.view!;
    return roots.reduce((most, { bounds }) => Math.max(most, farthestIn(bounds, eye)), 1);
  }
}
