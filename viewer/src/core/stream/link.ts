import type { LinkEstimate } from "./scheduler.js";

/** Seconds over which bandwidth is measured. */
const WINDOW = 2;
/** Bytes a second, until something has come. */
const FIRST_GUESS = 20_000;
const LEAST = 100;
/** Seconds that are too short to measure over. */
const AT_ONCE = 0.05;

/** How fast a link is: what came within the last seconds in which something was under way (BEN 4); the twin of `farfield.stream.link`. */
export class Link implements LinkEstimate {
  bandwidth = FIRST_GUESS;
  readonly latency: number;
  /** Bytes that were asked for and have not come. */
  underWay = 0;
  private came: { readonly at: number; readonly size: number }[] = [];
  private busySince = 0;
  /** Until when what comes waited together. */
  private settledAt = 0;

  constructor(latency = 0.1) {
    this.latency = latency;
  }

  /** So many bytes are asked for; times are in seconds. */
  sent(now: number, size: number): void {
    if (this.underWay === 0) {
      this.busySince = this.settledAt = now;
      this.came = [];
    }
    this.underWay += size;
  }

  /** So many bytes have come. */
  acknowledged(now: number, size: number): void {
    size = Math.min(size, this.underWay);
    if (size <= 0) return;
    this.underWay -= size;
    if (now < this.settledAt) return;
    this.came.push({ at: now, size });
    while (this.came[0]!.at < now - WINDOW) this.busySince = this.came.shift()!.at;
    // Only while something was under way: an idle link says nothing of how fast it is.
    const busy = now - this.busySince;
    const seconds = Math.max(busy - this.latency, busy - WINDOW, AT_ONCE);
    this.bandwidth = Math.max(this.came.reduce((sum, part) => sum + part.size, 0) / seconds, LEAST);
    if (this.came.length === 1 && busy > WINDOW) {
      // Nothing came for so long: what comes next tells whether the link is slow or was away, but not what comes in the same moment.
      this.came = [];
      this.busySince = now - this.latency;
      this.settledAt = now + AT_ONCE;
    }
  }

  /** So many bytes will not come. */
  givenUp(size: number): void {
    this.underWay = Math.max(this.underWay - size, 0);
  }
}
