import type { Vector3 } from "../core/vector.js";
import { CLEAR_SKY } from "../three/light.js";
import type { OptionChanges, WorldOptions } from "../three/options.js";
import type { Pose } from "./pose.js";

/** What an address keeps of a view: `#eye=x,y,z&target=x,y,z&fov=50&sun=225,35&sky=clear&haze=5000&shadows=1`. */
export interface Shared {
  readonly pose: Pose | null;
  readonly sun: readonly [azimuth: number, elevation: number] | null;
  /** Of the air: what is given there. */
  readonly air: Pick<OptionChanges, "sky" | "haze" | "shadows">;
}

/** What of the options an address keeps besides the sun. */
export function airOf({ sky, haze, shadows }: WorldOptions): Shared["air"] {
  return { sky, haze, shadows };
}

export function readHash(hash: string, defaultFov: number): Shared {
  const fields = new URLSearchParams(hash.replace(/^#/, ""));
  const eye = numbers(fields.get("eye"), 3) as Vector3 | null;
  const target = numbers(fields.get("target"), 3) as Vector3 | null;
  const [fov] = numbers(fields.get("fov"), 1) ?? [defaultFov];
  return {
    pose: eye && target ? { eye, target, fov: Math.min(140, Math.max(1, fov!)) } : null,
    sun: numbers(fields.get("sun"), 2) as [number, number] | null,
    air: readAir(fields),
  };
}

function readAir(fields: URLSearchParams): Shared["air"] {
  const [haze] = numbers(fields.get("haze"), 1) ?? [];
  return {
    ...(fields.get("sky") === CLEAR_SKY ? { sky: CLEAR_SKY } : {}),
    ...(haze !== undefined && haze > 0 ? { haze } : {}),
    ...(fields.get("shadows") === "1" ? { shadows: true } : {}),
  };
}

export function writeHash({ pose, sun, air }: Shared): string {
  const fields: string[] = [];
  if (pose) fields.push(`eye=${pose.eye.map(short)}`, `target=${pose.target.map(short)}`, `fov=${short(pose.fov)}`);
  if (sun) fields.push(`sun=${sun.map(short)}`);
  if (air.sky === CLEAR_SKY) fields.push("sky=clear");
  if (air.haze) fields.push(`haze=${short(air.haze)}`);
  if (air.shadows) fields.push("shadows=1");
  return `#${fields.join("&")}`;
}

function numbers(text: string | null, count: number): readonly number[] | null {
  const found = text?.split(",").map(Number) ?? [];
  return found.length === count && found.every(Number.isFinite) ? found : null;
}

/** Centimetres are enough to find a place again. */
function short(value: number): string {
  return String(Math.round(value * 100) / 100);
}
