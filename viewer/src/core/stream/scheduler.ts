import { MotionPredictor, type Viewing } from "./motion.js";
import { SHARES, type Offer, type Offering, type Use } from "./offers.js";
import { bestTotals } from "./orders.js";
import { cutoff, look, type Outlook } from "./outlook.js";

/** An object that shows something is changed for a gain of more than this only: changes are seen (BEN 4.2). */
const STEADY = 0.02;
/** Share of the cases in which a viewer does something else than it is expected to. */
const OTHERWISE = 0.1;
/** Items, those that add most for their time and as many that add most, of which all orders are compared. */
const LEADERS = 3;
/** By which another order must be better than that with the best for its time first: less is rounding. */
const BETTER = 1 + 1e-4;
/** Seconds that an item takes besides its bytes. */
const OVERHEAD = 0.002;
const PARTS = SHARES.length;
/** How much of an object each part is. */
const WEIGHTS = SHARES.map((end, n) => end - (n > 0 ? SHARES[n - 1]! : 0));

/** What to fetch. */
export interface Choice<Item> {
  readonly offer: Offer<Item>;
  /** Bytes that have not been chosen before, as parts of smaller offers. */
  readonly size: number;
  /** What it adds, pixel seconds. */
  readonly benefit: number;
  /** What it costs: seconds for which the link is taken by it. */
  readonly seconds: number;
}

/** What is known of the way to the server. */
export interface LinkEstimate {
  /** Bytes a second. */
  readonly bandwidth: number;
  /** Seconds from asking to having, bytes apart. */
  readonly latency: number;
}

/** Chooses what to fetch next, by what it adds for the time it takes (BEN 5); the twin of `farfield.stream.scheduler`. */
export class Scheduler<Item> {
  readonly predictor = new MotionPredictor();
  private outlook: Outlook = { bounds: [0, 0], eyes: [], visible: new Float64Array(), height: new Float64Array(), focal: 1, pixels: 1 };
  private offers: readonly Offer<Item>[] = [];
  /** Pixels of each object in each interval, times its importance. */
  private visible = new Float64Array();
  private held = new Float64Array();
  private benefits = new Float64Array();
  private rates = new Float64Array();
  private seconds = new Float64Array();
  private sizes = new Float64Array();
  /** Of the uses that were asked for, by object: a cell's are those of all its steps. */
  private readonly accuracies = new WeakMap<readonly Use[], ReadonlyMap<number, readonly number[]>>();
  private open: boolean[] = [];
  /** Nothing that is left would be there in time. */
  private late = false;
  /** Seconds for which the link is taken by what was chosen. */
  private taken = 0;

  constructor(
    private readonly offering: Offering<Item>,
    /** Metres to the far plane. */
    private readonly far: () => number,
    private readonly link: () => LinkEstimate,
  ) {}

  /** The viewer is there, now, in seconds of its clock. */
  follow(viewing: Viewing, now: number): void {
    const prediction = this.predictor.follow(viewing);
    const far = this.far();
    const boxes = this.offering.boxes(prediction, cutoff(prediction, now, far));
    this.outlook = look(prediction, boxes, now, far, OTHERWISE);
    const { offers, shown } = this.offering.offers(this.outlook);
    const intervals = this.outlook.bounds.length - 1;
    const importance = this.offering.importance(this.outlook);
    this.visible = this.outlook.visible.map((pixels, place) => pixels * importance[Math.floor(place / intervals)]!);
    this.held = new Float64Array(boxes.length * intervals * PARTS);
    for (const { object, accuracy, parts } of shown) this.raise(object, accuracy, parts);
    this.offers = offers;
    this.open = offers.map(() => true);
    this.taken = 0;
    this.late = false;
    this.sizes = Float64Array.from(offers, ({ size }) => size);
    this.seconds = this.sizes.map((size) => this.secondsOf(size));
    this.benefits = new Float64Array(offers.length);
    this.rates = new Float64Array(offers.length);
    this.renewAll(this.before(now));
  }

  /**
   * What to fetch now; null when nothing would add anything. Greedy by benefit a second of the link; when nothing would be there in
   * time, what would add most if it were there, for its time.
   */
  next(now: number): Choice<Item> | null {
    if (this.offers.length === 0) return null;
    const before = this.before(now);
    let best = this.leading(before);
    if (this.rates[best]! > 0 && !this.late) best = this.first(best, before);
    else if (!this.late) {
      this.late = true;
      this.renewAll(before);
      best = this.leading(before);
    }
    return this.rates[best]! > 0 ? this.take(best, before) : null;
  }

  /** All that adds something, in the order in which it should come. */
  order(now: number, most = Infinity): Choice<Item>[] {
    const found: Choice<Item>[] = [];
    while (found.length < most) {
      const choice = this.next(now);
      if (!choice) break;
      found.push(choice);
      this.taken += choice.size / this.link().bandwidth;
    }
    return found;
  }

  /** Seconds from the viewing on until something of no size that is asked for now would be there. */
  private before(now: number): number {
    const since = this.predictor.prediction ? now - this.predictor.prediction.viewing.time : 0;
    return since + this.link().latency + this.taken;
  }

  /**
   * The item that adds most for its time. Benefits only fall from one look to the next, so those that are known are bounds: only the
   * best is worked out anew, until it stays best.
   */
  private leading(before: number): number {
    let best = -1;
    for (let first = largest(this.rates); first !== best; first = largest(this.rates)) {
      best = first;
      this.renew(best, before);
    }
    return best;
  }

  private renewAll(before: number): void {
    for (let n = 0; n < this.offers.length; n++) this.renew(n, before);
  }

  private renew(n: number, before: number): void {
    this.benefits[n] = !this.open[n] ? 0 : this.added(n, this.late ? 0 : before + this.seconds[n]!);
    this.rates[n] = this.benefits[n]! / this.seconds[n]!;
  }

  /** Pixel seconds that an item adds to what is there, from its arrival to the cut-off: the added-benefit integral (BEN 5). */
  private added(n: number, arrival: number): number {
    const { bounds } = this.outlook;
    const { uses, parts } = this.offers[n]!;
    const intervals = bounds.length - 1;
    let total = 0;
    for (let k = 0; k < intervals; k++) {
      const begin = Math.max(bounds[k]!, arrival);
      if (begin >= bounds[k + 1]!) continue;
      let added = 0;
      for (const { object, accuracy } of uses) {
        const place = object * intervals + k;
        for (let part = 0; part < parts; part++) {
          const held = this.held[place * PARTS + part]!;
          const gain = accuracy[k]! - held;
          if (gain > STEADY || (gain > 0 && held === 0)) added += gain * WEIGHTS[part]! * this.visible[place]!;
        }
      }
      total += added * (bounds[k + 1]! - begin);
    }
    return total;
  }

  /**
   * The best for its time, or an item for which it can wait: a large one that is seen for a short time only. It is the first of the
   * best order of the items that lead.
   */
  private first(best: number, before: number): number {
    const items = this.leaders(best, before);
    const ordered = items.map((item) => ({ seconds: this.seconds[item]!, gains: this.gainsBeside(item, items) }));
    const totals = bestTotals(ordered, before, this.outlook.bounds);
    let first = 0;
    totals.forEach((total, n) => {
      if (total > totals[first]! * BETTER) first = n;
    });
    return items[first]!;
  }

  /** The best for its time first, then others that lead; of a series one alone. */
  private leaders(best: number, before: number): number[] {
    const found = new Map([[this.offers[best]!.series, best]]);
    for (const item of [...largestOf(this.rates, LEADERS), ...largestOf(this.benefits, LEADERS)]) {
      const { series } = this.offers[item]!;
      if (!found.has(series)) found.set(series, item);
    }
    const items = [...found.values()];
    for (const item of items) this.renew(item, before);
    return items.filter((item) => this.benefits[item]! > 0);
  }

  /** Pixels that an item adds in each interval beside each of some, and alone. */
  private gainsBeside(item: number, items: readonly number[]): Float64Array[] {
    const alone = this.gains(item, null);
    const { uses } = this.offers[item]!;
    return items.map((other) => {
      const beside = this.byObject(other);
      return other !== item && uses.some(({ object }) => beside.has(object)) ? this.gains(item, other) : alone;
    });
  }

  private gains(item: number, other: number | null): Float64Array {
    const gains = new Float64Array(this.outlook.bounds.length - 1);
    const { uses, parts } = this.offers[item]!;
    for (const { object, accuracy } of uses) {
      const beside = other === null ? undefined : this.byObject(other).get(object);
      const shown = beside ? this.offers[other!]!.parts : 0;
      for (let k = 0; k < gains.length; k++) {
        const place = object * gains.length + k;
        let added = 0;
        for (let part = 0; part < parts; part++) {
          const held = this.held[place * PARTS + part]!;
          const best = part < shown ? Math.max(held, beside![k]!) : held;
          const gain = accuracy[k]! - best;
          if (gain > STEADY || (gain > 0 && best === 0)) added += gain * WEIGHTS[part]!;
        }
        gains[k]! += added * this.visible[place]!;
      }
    }
    return gains;
  }

  /** The accuracy of an item in each interval, by what it shows. */
  private byObject(item: number): ReadonlyMap<number, readonly number[]> {
    const { uses } = this.offers[item]!;
    let found = this.accuracies.get(uses);
    if (!found) this.accuracies.set(uses, (found = new Map(uses.map(({ object, accuracy }) => [object, accuracy]))));
    return found;
  }

  private take(n: number, before: number): Choice<Item> {
    const offer = this.offers[n]!;
    const size = this.sizes[n]!;
    const choice = { offer, size, benefit: this.benefits[n]!, seconds: this.seconds[n]! };
    for (const { object, accuracy } of offer.uses) this.raise(object, accuracy, offer.parts);
    // What is chosen needs not come again, as a part of what is larger.
    this.offers.forEach(({ series }, other) => {
      if (series !== offer.series) return;
      this.open[other] = this.sizes[other]! > size;
      if (this.open[other]) {
        this.sizes[other]! -= size;
        this.seconds[other] = this.secondsOf(this.sizes[other]!);
      }
      this.renew(other, before);
    });
    return choice;
  }

  private secondsOf(size: number): number {
    return size / this.link().bandwidth + OVERHEAD;
  }

  private raise(object: number, accuracy: readonly number[], parts: number): void {
    const intervals = this.outlook.bounds.length - 1;
    for (let k = 0; k < intervals; k++) {
      const first = (object * intervals + k) * PARTS;
      for (let place = first; place < first + parts; place++) this.held[place] = Math.max(this.held[place]!, accuracy[k]!);
    }
  }
}

function largest(values: Float64Array): number {
  let best = -1;
  for (let n = 0; n < values.length; n++) if (best < 0 || values[n]! > values[best]!) best = n;
  return best;
}

/** Places of the largest few. */
function largestOf(values: Float64Array, count: number): number[] {
  const found: number[] = [];
  for (let n = 0; n < values.length; n++) {
    if (found.length === count && values[n]! <= values[found[count - 1]!]!) continue;
    if (found.length === count) found.pop();
    const place = found.findIndex((other) => values[other]! < values[n]!);
    found.splice(place < 0 ? found.length : place, 0, n);
  }
  return found;
}
