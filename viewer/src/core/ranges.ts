/** Runs of the pixels of one tile after the other, as `multiDrawArrays` takes them; adjacent ones are joined. */
export class Ranges {
  firsts = new Int32Array(1024);
  counts = new Int32Array(1024);
  /** Runs of all tiles. */
  total = 0;
  /** Where those of the present tile begin. */
  from = 0;
  /** Pixels of all runs. */
  pixels = 0;

  /** Runs of the present tile. */
  get length(): number {
    return this.total - this.from;
  }

  /** Begins a tile. */
  begin(): void {
    this.from = this.total;
  }

  /** Adds a run of the present tile, behind those before. */
  add(start: number, end: number): void {
    this.pixels += end - start;
    const last = this.total - 1;
    if (last >= this.from && this.firsts[last]! + this.counts[last]! === start) {
      this.counts[last]! += end - start;
      return;
    }
    if (this.total === this.firsts.length) [this.firsts, this.counts] = [doubled(this.firsts), doubled(this.counts)];
    this.firsts[this.total] = start;
    this.counts[this.total++] = end - start;
  }
}

function doubled(list: Int32Array): Int32Array<ArrayBuffer> {
  const longer = new Int32Array(list.length * 2);
  longer.set(list);
  return longer;
}
