/** What the best of all orders needs to know of each item; the twin of `farfield.kernels.orders`. */
export interface Ordered {
  readonly seconds: number;
  /** Pixels that it adds in each interval: beside each of the others, and alone at its own place. */
  readonly gains: readonly Float64Array[];
}

/**
 * What items add together in the best of all orders that begin with each of them, by dynamic programming over subsets (Held and Karp
 * 1962). `before`: seconds from where `bounds` begin until one that takes no time would be there.
 */
export function bestTotals(items: readonly Ordered[], before: number, bounds: ArrayLike<number>): number[] {
  const all = (1 << items.length) - 1;
  const taken = new Float64Array(all + 1).fill(before);
  for (let chosen = 1; chosen <= all; chosen++) {
    const last = 31 - Math.clz32(chosen);
    taken[chosen] = taken[chosen ^ (1 << last)]! + items[last]!.seconds;
  }
  // What the best order adds after some are chosen: from all of them back to none.
  const after = new Float64Array(all + 1);
  for (let chosen = all - 1; chosen > 0; chosen--) {
    for (let n = 0; n < items.length; n++) {
      const more = chosen | (1 << n);
      if (more === chosen) continue;
      after[chosen] = Math.max(after[chosen]!, added(items[n]!.gains, n, chosen, taken[more]!, bounds) + after[more]!);
    }
  }
  return items.map(({ gains }, first) => added(gains, first, 0, taken[1 << first]!, bounds) + after[1 << first]!);
}

/** The integral of what item n adds from its arrival on beside the chosen ones: no more than beside any of them. */
function added(gains: readonly Float64Array[], n: number, chosen: number, arrival: number, bounds: ArrayLike<number>): number {
  let total = 0;
  for (let k = 0; k + 1 < bounds.length; k++) {
    const begin = Math.max(bounds[k]!, arrival);
    if (begin >= bounds[k + 1]!) continue;
    let gain = gains[n]![k]!;
    for (let other = 0; other < gains.length; other++) if ((chosen >> other) & 1) gain = Math.min(gain, gains[other]![k]!);
    total += gain * (bounds[k + 1]! - begin);
  }
  return total;
}
