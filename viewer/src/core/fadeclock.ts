/** Of the time that a picture takes to go over into another, after which the share that is left of it has fallen to 1/e. */
const DECAY = 1 / 3;

/** How much of what was shown before is still to be seen, by time. */
export class FadeClock {
  private changedAt = -Infinity;
  private shownAt = -Infinity;
  private last = 1;

  /** Whether something of a picture before is shown still. */
  get fading(): boolean {
    return this.last < 1;
  }

  /**
   * Weight of the picture that is shown at a time, milliseconds; the rest is for what is shown until then. fresh: it is another one.
   * seconds: until nothing is left of what was shown before; 0: at once. Where one picture follows the other, each share falls by an
   * exponential law; of one that stays, nothing else is left in the end.
   */
  weight(now: number, fresh: boolean, seconds: number): number {
    if (fresh) this.changedAt = now;
    const passed = now - this.shownAt;
    const all = 1000 * seconds;
    const left = this.changedAt + all - this.shownAt;
    this.shownAt = now;
    const share = 1 - Math.exp(-passed / (all * DECAY));
    this.last = passed >= all || passed >= left ? 1 : Math.max(share, passed / left);
    return this.last;
  }
}
