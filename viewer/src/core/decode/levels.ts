/** One size of an image. */
export interface Level {
  /** (height, width, 4) sRGB and straight alpha. */
  readonly pixels: Uint8ClampedArray;
  readonly width: number;
  readonly height: number;
}

const LINEAR = Float32Array.from({ length: 256 }, (_, byte) => {
  const c = byte / 255;
  return c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
});

const STEPS = 4095;
const SRGB = Uint8Array.from({ length: STEPS + 1 }, (_, step) => {
  const c = step / STEPS;
  return Math.round(255 * (c <= 0.0031308 ? c * 12.92 : 1.055 * c ** (1 / 2.4) - 0.055));
});

/** Linear light weighted by alpha, and alpha, interleaved. */
interface Weighted {
  readonly values: Float32Array;
  readonly width: number;
  readonly height: number;
}

/**
 * A cut-out image and all its halves down to 1 x 1. Averages are taken in linear light and weighted by alpha, and texels
 * without any take the colour of the next smaller size, so that what is cut away never bleeds into what is not.
 */
export function maskedLevels(pixels: Uint8ClampedArray, width: number, height: number): Level[] {
  const weighted: Weighted[] = [weigh(pixels, width, height)];
  for (let last = weighted[0]!; last.width > 1 || last.height > 1; last = weighted.at(-1)!) weighted.push(halve(last));
  const levels: Level[] = [];
  for (let n = weighted.length - 1; n >= 0; n--) levels.unshift(unweigh(weighted[n]!, levels[0]));
  return levels;
}

function weigh(pixels: Uint8ClampedArray, width: number, height: number): Weighted {
  const values = new Float32Array(pixels.length);
  for (let at = 0; at < pixels.length; at += 4) {
    const alpha = pixels[at + 3]! / 255;
    for (let c = 0; c < 3; c++) values[at + c] = LINEAR[pixels[at + c]!]! * alpha;
    values[at + 3] = alpha;
  }
  return { values, width, height };
}

function halve({ values, width, height }: Weighted): Weighted {
  const [columns, rows] = [Math.max(1, width >> 1), Math.max(1, height >> 1)];
  const half = new Float32Array(columns * rows * 4);
  for (let row = 0, at = 0; row < rows; row++) {
    const [above, below] = [Math.min(2 * row, height - 1) * width, Math.min(2 * row + 1, height - 1) * width];
    for (let column = 0; column < columns; column++) {
      const [left, right] = [Math.min(2 * column, width - 1), Math.min(2 * column + 1, width - 1)];
      const [a, b, c, d] = [(above + left) * 4, (above + right) * 4, (below + left) * 4, (below + right) * 4];
      for (let n = 0; n < 4; n++) half[at++] = 0.25 * (values[a + n]! + values[b + n]! + values[c + n]! + values[d + n]!);
    }
  }
  return { values: half, width: columns, height: rows };
}

function unweigh({ values, width, height }: Weighted, smaller: Level | undefined): Level {
  const pixels = new Uint8ClampedArray(values.length);
  for (let at = 0; at < values.length; at += 4) {
    const alpha = values[at + 3]!;
    pixels[at + 3] = alpha * 255;
    if (alpha > 0) {
      for (let c = 0; c < 3; c++) pixels[at + c] = SRGB[Math.min(STEPS, Math.round((values[at + c]! / alpha) * STEPS))]!;
    } else if (smaller) {
      const row = Math.min((at / 4 / width) >> 1, smaller.height - 1);
      const column = Math.min(((at / 4) % width) >> 1, smaller.width - 1);
      const from = (row * smaller.width + column) * 4;
      pixels.set(smaller.pixels.subarray(from, from + 3), at);
    }
  }
  return { pixels, width, height };
}
