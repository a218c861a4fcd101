import type { Projection } from "./projection.js";

interface Level {
  readonly columns: number;
  readonly rows: number;
  readonly values: Float32Array;
}

/** Texels a side that a look-up reads at most; more, and it takes the next smaller size. */
const MOST = 4;

/**
 * How far one sees in a picture that was drawn, in squares and in squares of squares: of each the least near / distance, 0 where one
 * sees past everything.
 */
export class DepthPyramid {
  private readonly levels: Level[];

  /**
   * view: of the picture. texel: pixels a side of a square. values: (rows, columns) from the picture's lower left corner; together
   * they cover all of it.
   */
  constructor(
    readonly view: Projection,
    readonly texel: number,
    columns: number,
    values: Float32Array,
  ) {
    this.levels = [{ columns, rows: values.length / columns, values }];
    for (let last = this.levels[0]!; last.columns > 1 || last.rows > 1; last = this.levels.at(-1)!) this.levels.push(halved(last));
  }

  /** Whether everything within a rectangle of the picture, pixels, is nearer than `distance` along the view axis, metres. */
  closes(left: number, bottom: number, right: number, top: number, distance: number): boolean {
    const limit = (this.view.near / distance) * ROUNDING;
    let [c0, c1] = [Math.floor(left / this.texel), Math.floor(right / this.texel)];
    let [r0, r1] = [Math.floor(bottom / this.texel), Math.floor(top / this.texel)];
    let n = 0;
    for (; c1 - c0 >= MOST || r1 - r0 >= MOST; n++) [c0, c1, r0, r1] = [c0 >> 1, c1 >> 1, r0 >> 1, r1 >> 1];
    const { columns, rows, values } = this.levels[Math.min(n, this.levels.length - 1)]!;
    for (let row = Math.max(0, r0); row <= Math.min(rows - 1, r1); row++) {
      for (let column = Math.max(0, c0); column <= Math.min(columns - 1, c1); column++) {
        if (values[row * columns + column]! <= limit) return false;
      }
    }
    return true;
  }
}

/** More than the rounding of a distance in single precision. */
const ROUNDING = 1 + 1e-5;

function halved({ columns, rows, values }: Level): Level {
  const [half, high] = [(columns + 1) >> 1, (rows + 1) >> 1];
  const least = new Float32Array(half * high).fill(Infinity);
  for (let row = 0, from = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++, from++) {
      const at = (row >> 1) * half + (column >> 1);
      if (values[from]! < least[at]!) least[at] = values[from]!;
    }
  }
  return { columns: half, rows: high, values: least };
}
