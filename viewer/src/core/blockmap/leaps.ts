/**
 * How far a ray may leap over a BlockMap (spec/drawing.md, BlockMaps): distances to the nearest texel that is higher than each of three
 * heights. The twin of `leap_heights` in src/farfield/view/blockmaps.py and of src/farfield/kernels/leaps.py.
 */

/** Heights that there are distances for. */
export const LEAPS = 3;
const [SHARE_OF_GROUND, MOST, NEARLY] = [0.05, 0.75, 0.97];
const FARTHEST = 254;

/** The highest points of texels, metres from the cell's lower corner; -Infinity where there is nothing. */
export function topsOf(
  codes: Uint8Array, slopes: Int8Array | null, low: number, step: number, texel: readonly [number, number], steep: number,
): Float32Array {
  const f = Math.fround;
  const tops = new Float32Array(codes.length).fill(-Infinity);
  for (let at = 0; at < codes.length; at++) {
    if (codes[at] === 0) continue;
    const height = f(low + f((codes[at]! - 1) * step));
    const x = slopes ? Math.abs(f((slopes[2 * at]! / steep) * texel[0])) : 0;
    const y = slopes ? Math.abs(f((slopes[2 * at + 1]! / steep) * texel[1])) : 0;
    tops[at] = height + f(f(x + y) / 2);
  }
  return tops;
}

/** Heights to tell distances for, in single precision: of the ground, of most buildings, of nearly all. */
export function leapHeights(tops: Float32Array): [number, number, number] {
  const known = tops.filter((top) => top > -Infinity).sort();
  const [low, high] = [known[0]!, known.at(-1)!];
  const ground = low + SHARE_OF_GROUND * (high - low);
  return [ground, Math.max(quantile(known, MOST), ground), Math.max(quantile(known, NEARLY), ground)].map(Math.fround) as [number, number, number];
}

/** As numpy's linear method, of sorted numbers in single precision. */
function quantile(sorted: Float32Array, share: number): number {
  const at = (sorted.length - 1) * share;
  const first = Math.floor(at);
  const [a, b] = [sorted[first]!, sorted[Math.min(first + 1, sorted.length - 1)]!];
  const [t, difference] = [at - first, Math.fround(b - a)];
  return t >= 0.5 ? b - difference * (1 - t) : a + difference * t;
}

/**
 * (n, n) heights to (n, n) texels to the nearest one above `height`, 0 = itself, written to every fourth byte from `at` on. Distances are
 * those of a king on a chess board: all texels within one less are no higher. 255 at most.
 */
export function writeDistances(tops: Float32Array, n: number, height: number, out: Uint8Array, at: number): void {
  // With a rim of far ones around.
  const row = n + 2;
  const held = new Uint8Array(row * row).fill(FARTHEST);
  for (let j = 1; j <= n; j++) {
    for (let i = 1, to = j * row + 1; i <= n; i++, to++) {
      if (tops[(j - 1) * n + i - 1]! > height) held[to] = 0;
      else held[to] = Math.min(held[to - row - 1]!, held[to - row]!, held[to - row + 1]!, held[to - 1]!, FARTHEST) + 1;
    }
  }
  for (let j = n; j >= 1; j--) {
    for (let i = n, to = j * row + n; i >= 1; i--, to--) {
      const found = Math.min(held[to + row + 1]!, held[to + row]!, held[to + row - 1]!, held[to + 1]!, FARTHEST) + 1;
      held[to] = Math.min(held[to]!, found);
      out[4 * ((j - 1) * n + i - 1) + at] = held[to]!;
    }
  }
}
