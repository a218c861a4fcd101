import type { Vector3 } from "../core/vector.js";
import type { Pose } from "./pose.js";

/** What an address keeps of a view: `#eye=x,y,z&target=x,y,z&fov=50&sun=225,35`. */
export interface Shared {
  readonly pose: Pose | null;
  readonly sun: readonly [azimuth: number, elevation: number] | null;
}

export function readHash(hash: string, defaultFov: number): Shared {
  const fields = new URLSearchParams(hash.replace(/^#/, ""));
  const eye = numbers(fields.get("eye"), 3) as Vector3 | null;
  const target = numbers(fields.get("target"), 3) as Vector3 | null;
  const [fov] = numbers(fields.get("fov"), 1) ?? [defaultFov];
  return {
    pose: eye && target ? { eye, target, fov: Math.min(140, Math.max(1, fov!)) } : null,
    sun: numbers(fields.get("sun"), 2) as [number, number] | null,
  };
}

export function writeHash({ pose, sun }: Shared): string {
  const fields: string[] = [];
  if (pose) fields.push(`eye=${pose.eye.map(short)}`, `target=${pose.target.map(short)}`, `fov=${short(pose.fov)}`);
  if (sun) fields.push(`sun=${sun.map(short)}`);
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
