/** What a viewer and the server say to each other in a session (spec/stream.md); the twin of `farfield.serve.push.messages`. */
import { FarfieldError } from "../errors.js";
import { isCount, isObject } from "../limits.js";
import type { Vector3 } from "../vector.js";

export const VERSION = 1;
/** Keys in a message of a viewer at most, and characters: the rest of 256 KiB is for what stands round them. */
const MOST_KEYS = 4096;
const MOST_CHARACTERS = 250 << 10;
/** Number and offset before each piece of a value. */
const PIECE_HEADER_BYTES = 8;
const KEY = /^(?:orthoview|blockmap|geometry|mesh|texture|impostor)\/[0-9a-f/-]{1,150}$/;

/** Where a viewer is, how it moves, and how it draws. */
export interface ViewMessage {
  readonly eye: Vector3;
  readonly forward: Vector3;
  /** Vertical, degrees. */
  readonly fov: number;
  readonly size: readonly [number, number];
  readonly velocity: Vector3;
  readonly acceleration: Vector3;
  readonly turning: number;
  readonly nearRadius: number;
  readonly bias: number;
  readonly leastGain: number;
  readonly farGeometry: boolean;
  readonly dynamicImpostors: boolean;
}

export type FromServer =
  | { readonly type: "welcome"; readonly generation: number }
  | { readonly type: "value"; readonly number: number; readonly key: string; readonly bytes: number }
  | { readonly type: "cancelled"; readonly number: number }
  | { readonly type: "missing"; readonly key: string }
  | { readonly type: "idle" };

/** A part of a value. */
export interface Piece {
  readonly number: number;
  readonly offset: number;
  readonly part: Uint8Array;
}

/** The error of a server that does not keep to the rules of a session. */
export function broken(what: string): FarfieldError {
  return new FarfieldError("corrupt", what, "stream");
}

/** A message of the server; null: of a kind that a later version may know. Throws `corrupt`. */
export function readMessage(text: string): FromServer | null {
  const message = parse(text);
  const { type, number, key, bytes, generation } = message;
  const isSane: Readonly<Record<string, () => boolean>> = {
    welcome: () => isCount(generation),
    value: () => isCount(number) && isKey(key) && isCount(bytes),
    cancelled: () => isCount(number),
    missing: () => isKey(key),
    idle: () => true,
  };
  if (typeof type !== "string") throw broken("the server says something without a type");
  if (!Object.hasOwn(isSane, type)) return null;
  if (!isSane[type]!()) throw broken(`the server says ${type} of what cannot be`);
  return message as unknown as FromServer;
}

/** A piece of a value, without a copy. Throws `corrupt`. */
export function readPiece(message: ArrayBuffer): Piece {
  if (message.byteLength <= PIECE_HEADER_BYTES) throw broken("a piece of a value is cut short");
  const header = new DataView(message);
  return { number: header.getUint32(0, true), offset: header.getUint32(4, true), part: new Uint8Array(message, PIECE_HEADER_BYTES) };
}

/** Keys in shares that a message each may hold. */
export function shared(keys: Iterable<string>): string[][] {
  const shares: string[][] = [];
  let room = 0;
  for (const key of keys) {
    const size = key.length + 3;
    const last = shares.at(-1);
    if (last && last.length < MOST_KEYS && size <= room) last.push(key);
    else {
      shares.push([key]);
      room = MOST_CHARACTERS;
    }
    room -= size;
  }
  return shares;
}

function isKey(value: unknown): value is string {
  return typeof value === "string" && KEY.test(value);
}

function parse(text: string): Readonly<Record<string, unknown>> {
  try {
    const found: unknown = JSON.parse(text);
    if (isObject(found)) return found;
  } catch {
    // No JSON at all, or nested deeper than the stack: the same to the caller.
  }
  throw broken("the server says what is no message");
}
