import type { Vector3 } from "../core/vector.js";

/** A clear sky that follows the sun (spec/drawing.md, Sky), by the same numbers as farfield.view.sky. Linear light. */
export interface ClearSky {
  readonly zenith: Vector3;
  /** At the horizon below the sun, and opposite it. */
  readonly towards: Vector3;
  readonly away: Vector3;
  /** Colour of the sun: about white by day, red when it is low, black once it has set. */
  readonly sunlight: Vector3;
  /** Colour of the light from all of the sky, with a luminance of 1 by day. */
  readonly ambient: Vector3;
}

/** Zenith, horizon below the sun, horizon opposite it. */
type Times = readonly [Vector3, Vector3, Vector3];
const DAY: Times = [[0.13, 0.27, 0.62], [0.52, 0.66, 0.85], [0.52, 0.66, 0.85]];
const DUSK: Times = [[0.07, 0.11, 0.24], [0.66, 0.36, 0.18], [0.24, 0.21, 0.27]];
const NIGHT: Times = [[0.004, 0.006, 0.014], [0.012, 0.015, 0.028], [0.012, 0.015, 0.028]];
const AIR: Vector3 = [0.022, 0.06, 0.14];
const NIGHT_LIGHT = 0.12;
const TINT = 0.35;

/** sun: unit vector towards the sun, z up. */
export function clearSky(sun: Vector3): ClearSky {
  const height = sun[2];
  const day = smooth(-0.12, 0.2, height);
  const dusk = Math.exp(-((height / 0.2) ** 2));
  const [zenith, towards, away] = [0, 1, 2].map((n) =>
    each((c) => NIGHT[n]![c]! + day * (DAY[n]![c]! + dusk * (DUSK[n]![c]! - DAY[n]![c]!) - NIGHT[n]![c]!)),
  ) as unknown as Times;
  const up = Math.max(height, 0);
  const air = 1 / (up + 0.025 * Math.exp(-11 * up));
  const risen = smooth(-0.02, 0.02, height);
  const mean = each((c) => (zenith[c]! + (towards[c]! + away[c]!) / 2) / 2);
  const noon = luminance(each((c) => (DAY[0][c]! + DAY[1][c]!) / 2));
  const light = luminance(mean);
  return {
    zenith, towards, away,
    sunlight: each((c) => Math.exp(-(air - 1) * AIR[c]!) * risen),
    ambient: each((c) => NIGHT_LIGHT + ((1 - NIGHT_LIGHT) * (light + TINT * (mean[c]! - light))) / noon),
  };
}

function each(channel: (c: number) => number): Vector3 {
  return [channel(0), channel(1), channel(2)];
}

function luminance([r, g, b]: Vector3): number {
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

function smooth(first: number, last: number, value: number): number {
  const share = Math.min(1, Math.max(0, (value - first) / (last - first)));
  return share * share * (3 - 2 * share);
}
