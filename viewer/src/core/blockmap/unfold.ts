/**
 * The walls of a BlockMap unfolded (spec/blockmap.md, Walls): which sides of its texels are walls, in the order in which one walks along
 * them, and where in the image of walls each has its place. The twin of src/farfield/represent/blockmap/unfolding.py.
 */
import type { BlockMapHeader } from "./header.js";

/** Sides of a texel: side 4 (n j + i) + k of texel (i, j). */
export const [WEST, EAST, SOUTH, NORTH] = [0, 1, 2, 3] as const;
/** Columns of a side, and sides that share them, by density. */
const DENSITIES = [[4, 1], [3, 1], [2, 1], [1, 1], [1, 2], [1, 4], [1, 8], [1, 16]] as const;
/** Rows of the image of walls that a side may have. */
const ROWS = [1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64];
// Along a side with the body on the left: south eastwards, east northwards, north westwards, west southwards.
const [ALONG_X, ALONG_Y] = [[0, 0, 1, -1], [-1, 1, 0, 0]] as const;
const [OUT_X, OUT_Y] = [[-1, 1, 0, 0], [0, 0, -1, 1]] as const;
/** The next side of the same texel, and that of the texel diagonally ahead, where the wall turns inwards. */
const [LEFT, RIGHT] = [[SOUTH, NORTH, EAST, WEST], [NORTH, SOUTH, WEST, EAST]] as const;

/** What heights alone tell of walls. */
export interface Unfolded {
  /** (count) the sides whose normals are told, in that order; by column, the west side of each texel with a wall. */
  readonly sides: Int32Array;
  /** (4 n n, 3) of each side its first column and row in the image of walls, and its rows; 0 rows: no wall. */
  readonly places: Int32Array;
  /** (4 n n) which of `sides` tells its normal; -1: no wall. */
  readonly normal: Int32Array;
  /** Columns of a side. */
  readonly across: number;
  /** Of the image that are used. */
  readonly rows: number;
}

type Walling = Pick<BlockMapHeader, "n" | "m" | "byArea" | "density" | "least" | "scale">;

/** codes: (n, n). floors: (n, n) where bodies end below; null: at the lowest code. rim: 4 n bits, least significant first. */
export function unfolded(codes: Uint8Array, floors: Uint8Array | null, rim: Uint8Array, walling: Walling): Unfolded {
  const drops = dropsOf(codes, floors, rim, walling);
  const order = traced(drops, walling.n);
  return walling.byArea ? placedByArea(drops, order, walling) : placedByColumn(order, walling);
}

/** (4 n n) how many steps of height each side goes down; 0: it is no wall. */
function dropsOf(codes: Uint8Array, floors: Uint8Array | null, rim: Uint8Array, { n, least }: Walling): Uint8Array {
  const drops = new Uint8Array(4 * n * n);
  for (let side = 0; side < drops.length; side++) {
    const [texel, k] = [side >> 2, side & 3];
    const code = codes[texel]!;
    if (code === 0) continue;
    const base = Math.max(floors?.[texel] ?? 0, 1);
    const [i, j] = [texel % n, Math.floor(texel / n)];
    const [x, y] = [i + OUT_X[k]!, j + OUT_Y[k]!];
    if (x < 0 || y < 0 || x >= n || y >= n) {
      const bit = k * n + (k < SOUTH ? j : i);
      if ((rim[bit >> 3]! >> (bit & 7)) & 1) drops[side] = Math.max(code - base, 1);
      continue;
    }
    const beside = codes[n * y + x]!;
    const drop = beside === 0 ? Math.max(code - base, 1) : code - Math.max(beside, base);
    if (drop >= least || (beside === 0 && code > base)) drops[side] = drop;
  }
  return drops;
}

/** The sides that are walls, those of a wall in a row. */
function traced(drops: Uint8Array, n: number): Int32Array {
  const open = drops.map((drop) => Math.min(drop, 1));
  const order = new Int32Array(drops.length);
  let count = 0;
  const sideOf = (x: number, y: number, k: number): number =>
    x >= 0 && y >= 0 && x < n && y < n && open[4 * (n * y + x) + k] ? 4 * (n * y + x) + k : -1;
  for (let first = 0; first < drops.length; first++) {
    for (let side = open[first] ? first : -1; side >= 0; ) {
      open[side] = 0;
      order[count++] = side;
      const [x, y, k] = [(side >> 2) % n, Math.floor((side >> 2) / n), side & 3];
      const [aheadX, aheadY] = [x + ALONG_X[k]!, y + ALONG_Y[k]!];
      side = sideOf(x, y, LEFT[k]!);
      if (side < 0) side = sideOf(aheadX, aheadY, k);
      if (side < 0) side = sideOf(aheadX + OUT_X[k]!, aheadY + OUT_Y[k]!, RIGHT[k]!);
    }
  }
  return order.slice(0, count);
}

/** Texels by the area of a wall: the highest first, row beside row. */
function placedByArea(drops: Uint8Array, order: Int32Array, { n, m, density, scale }: Walling): Unfolded {
  const [across, sharing] = DENSITIES[density]!;
  const choices = ROWS.filter((rows) => rows <= n);
  const rowsOf = Uint8Array.from({ length: 256 }, (_, drop) => choices.find((rows) => rows >= (drop * scale + 255) >> 8) ?? choices.at(-1)!);
  const wanted = new Uint8Array(order.length);
  for (let at = 0; at < order.length; at++) wanted[at] = rowsOf[drops[order[at]!]!]!;
  const places = new Int32Array(3 * drops.length);
  let [placed, top, height, column] = [0, 0, 0, m];
  for (const rows of choices.reverse()) {
    for (let at = 0; at < order.length; at++) {
      if (wanted[at] !== rows) continue;
      if (placed++ % sharing === 0) {
        column += across;
        if (column + across > m) [top, height, column] = [top + height, rows, 0];
      }
      const to = 3 * order[at]!;
      places[to] = column;
      places[to + 1] = top;
      places[to + 2] = rows;
    }
  }
  const normal = new Int32Array(drops.length).fill(-1);
  order.forEach((side, at) => (normal[side] = at));
  return { sides: order, places, normal, across, rows: top + height };
}

/** A column for each texel with a wall, that all its sides share. */
function placedByColumn(order: Int32Array, { n, m }: Walling): Unfolded {
  const numbers = new Map<number, number>();
  for (const side of order) if (!numbers.has(side >> 2)) numbers.set(side >> 2, numbers.size);
  const places = new Int32Array(12 * n * n);
  const normal = new Int32Array(4 * n * n).fill(-1);
  for (const side of order) {
    const number = numbers.get(side >> 2)!;
    normal[side] = number;
    places[3 * side] = Math.floor((number * m) / Math.max(numbers.size, m));
    places[3 * side + 2] = n;
  }
  return { sides: Int32Array.from(numbers.keys(), (texel) => 4 * texel), places, normal, across: 1, rows: n };
}
