/** What the numbers and names in the JSON of a world may be (spec/world.md, Limits). */
import type { Box, Vector3 } from "./vector.js";

export const MAXIMUM_LEVEL = 40;
const MAXIMUM_METRES = 1e12;
const HASH = /^[0-9a-f]{16}$/;

export type Json = Readonly<Record<string, unknown>>;

export function isObject(value: unknown): value is Json {
  return value !== null && typeof value === "object" && !Array.isArray(value);
}

/** 16 hexadecimal digits: part of an address, so nothing else will do. */
export function isHash(value: unknown): value is string {
  return typeof value === "string" && HASH.test(value);
}

/** A whole number from 0 to `most`. */
export function isCount(value: unknown, most = Number.MAX_SAFE_INTEGER): value is number {
  return Number.isInteger(value) && (value as number) >= 0 && (value as number) <= most;
}

/** A number of metres with which sums do not overflow. */
export function isMetres(value: unknown): value is number {
  return typeof value === "number" && Math.abs(value) <= MAXIMUM_METRES;
}

/** At most so many of something. */
export function isList<T>(value: unknown, is: (item: unknown) => item is T, most = Infinity): value is readonly T[] {
  return Array.isArray(value) && value.length <= most && value.every(is);
}

export function isVector(value: unknown): value is Vector3 {
  return isList(value, isMetres, 3) && value.length === 3;
}

/** Lower and upper corner, no lower bound above its upper one. */
export function isBounds(value: unknown): value is readonly [Vector3, Vector3] {
  if (!isList(value, isVector, 2) || value.length !== 2) return false;
  const [lower, upper] = value as readonly [Vector3, Vector3];
  return lower.every((least, axis) => least <= upper[axis]!);
}

/** The same as a box; null when it is none. */
export function boxOf(value: unknown): Box | null {
  return isBounds(value) ? { lower: value[0], upper: value[1] } : null;
}
