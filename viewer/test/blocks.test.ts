import { describe, expect, it } from "vitest";
import { BOX, CONE, orderInBlocks } from "../src/core/orthoview/blocks.js";
import { decodeTile, WORDS, type DecodedTile } from "../src/core/orthoview/decode.js";
import { listVectors, readVector } from "./vectors.js";

const grey = (_: Uint8Array, width: number, height: number): Promise<Uint8ClampedArray> =>
  Promise.resolve(new Uint8ClampedArray(width * height * 4).fill(99));
const tileOf = (name: string): Promise<DecodedTile> => decodeTile(readVector(`tiles/${name}`), name, grey);

interface Pixel {
  readonly place: readonly [number, number, number];
  readonly normal: readonly [number, number, number];
  readonly connected: boolean;
}

/** A pixel as the vertex shader reads it. */
function pixelAt(pixels: Uint32Array, k: number): Pixel {
  const [place, color, surface] = pixels.subarray(k * WORDS, k * WORDS + WORDS) as unknown as [number, number, number];
  const depth = ((place >>> 24) | ((color >>> 24) << 8)) / 8;
  const [s, t] = [(surface & 63) * (2 / 63) - 1, ((surface >>> 6) & 63) * (2 / 63) - 1];
  const [x, y] = [(s + t) / 2, (s - t) / 2];
  const z = -Math.max(0, 1 - Math.abs(x) - Math.abs(y));
  const length = Math.hypot(x, y, z);
  return {
    place: [(place & 4095) + 0.5, ((place >>> 12) & 4095) + 0.5, depth],
    normal: [x / length, y / length, z / length],
    connected: (surface & 0x80000) !== 0,
  };
}

/** Corners of the square round a splat's ellipse, in its tangent plane; of the cube round a disc that faces the eye, wherever that is. */
function reachOf({ place, normal: [x, y, z], connected }: Pixel): number[][] {
  const below = Math.min(z, -0.001);
  const slope = (part: number): number => Math.max(-4, Math.min(4, -part / below));
  const turns = Array.from({ length: 16 }, (_, n) => (n / 8) * Math.PI);
  const [a, b] = [slope(x), slope(y)];
  return turns.flatMap((turn) => {
    const [u, v] = [Math.cos(turn) * Math.SQRT1_2, Math.sin(turn) * Math.SQRT1_2];
    const [i, j, k] = place;
    return connected ? [[i + u, j + v, k + a * u + b * v]] : [[i + u, j + v, k], [i + u, j, k + v], [i, j + u, k + v]];
  });
}

describe("blocks of a tile", () => {
  const names = listVectors("tiles", ".ffov");

  it.each(names)("%s: every pixel once, neighbours in place together", async (name) => {
    const { pixels, blocks, count, width } = await tileOf(name);
    expect([blocks.starts[0], blocks.starts[blocks.count]]).toEqual([0, count]);
    const places = new Set(Array.from({ length: count }, (_, k) => pixels[k * WORDS]! & 0xffffff));
    expect(places.size).toBe(count);
    for (let n = 0; n < blocks.count; n++) {
      expect(blocks.starts[n + 1]!).toBeGreaterThan(blocks.starts[n]!);
      const squares = new Set<number>();
      for (let k = blocks.starts[n]!; k < blocks.starts[n + 1]!; k++) {
        const [column, row] = pixelAt(pixels, k).place;
        squares.add(Math.floor(row / 32) * width + Math.floor(column / 32));
      }
      expect(squares.size).toBe(1);
    }
  });

  it.each(names)("%s: a box holds all of its footprints, a cone all of its normals", async (name) => {
    const { pixels, blocks } = await tileOf(name);
    // Most that anything is outside its box, pitches, or its cone.
    let [outside, aside] = [-Infinity, -Infinity];
    for (let n = 0; n < blocks.count; n++) {
      const box = blocks.boxes.subarray(n * BOX, n * BOX + BOX);
      const [x, y, z, cosine, sine] = blocks.cones.subarray(n * CONE, n * CONE + CONE) as unknown as [number, number, number, number, number];
      expect(cosine * cosine + sine * sine).toBeCloseTo(1, 5);
      let loose = false;
      for (let k = blocks.starts[n]!; k < blocks.starts[n + 1]!; k++) {
        const pixel = pixelAt(pixels, k);
        for (const point of reachOf(pixel)) {
          for (let a = 0; a < 3; a++) outside = Math.max(outside, box[a]! - point[a]!, point[a]! - box[a + 3]!);
        }
        loose ||= !pixel.connected;
        const [nx, ny, nz] = pixel.normal;
        aside = Math.max(aside, cosine - (nx * x + ny * y + nz * z));
      }
      if (loose) expect([cosine, sine]).toEqual([0, 1]);
    }
    expect(outside).toBeLessThan(1e-3);
    expect(aside).toBeLessThan(1e-5);
  });

  it("what lies far behind is a block of its own", () => {
    const word = (column: number, row: number): number => column | (row << 12);
    const deep = (depth: number): [number, number] => [(depth & 255) << 24, (depth >> 8) << 24];
    const pixels: number[] = [];
    for (let row = 0; row < 32; row++) {
      for (let column = 0; column < 32; column++) {
        const [low, high] = deep((row + column) % 2 ? 40 : 40_000);
        pixels.push((word(column, row) | low) >>> 0, high >>> 0, 0);
      }
    }
    const { blocks } = orderInBlocks(Uint32Array.from(pixels), 32);
    expect([...blocks.starts]).toEqual([0, 512, 1024]);
    expect(blocks.boxes[5]! - blocks.boxes[2]!).toBeLessThan(2);
    expect(blocks.boxes[BOX + 2]).toBeCloseTo(5000 - Math.SQRT1_2, 2);
  });
});
