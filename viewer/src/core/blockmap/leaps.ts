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
  return Float32Array.from(codes, (code, at) => {
    if (code === 0) return -Infinity;
    const height = f(low + f((code - 1) * step));
    if (!slopes) return height;
    const [x, y] = [0, 1].map((axis) => Math.abs(f((slopes[2 * at + axis]! / steep) * texel[axis]!))) as [number, number];
    return f(height + f(f(x + y) / 2));
  });
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
  const held = (i: number, j: number): number => (i < 0 || j < 0 || i >= n || j >= n ? FARTHEST : out[4 * (n * j + i) + at]!);
  const nearest = (i: number, j: number, way: 1 | -1): number =>
    Math.min(held(i - 1, j - way), held(i, j - way), held(i + 1, j - way), held(i - way, j), FARTHEST) + 1;
  for (let j = 0; j < n; j++) {
    for (let i = 0; i < n; i++) out[4 * (n * j + i) + at] = tops[n * j + i]! > height ? 0 : nearest(i, j, 1);
  }
  for (let j = n - 1; j >= 0; j--) {
    for (let i = n - 1; i >= 0; i--) out[4 * (n * j + i) + at] = Math.min(held(i, j), nearest(i, j, -1));
  }
}
