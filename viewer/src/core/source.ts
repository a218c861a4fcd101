import { FarfieldError } from "./errors.js";

/** A value; null: there is none; an error: it is damaged, while others of the same request are not. */
export type Found = Uint8Array | null | FarfieldError;

/** Where the values of a world come from: a folder on a web server, or an archive there. */
export interface Source {
  /** Address of the folder, or of the archive as if it were one; with a slash at its end. */
  readonly base: string;
  /** Bytes and requests since the start. */
  readonly bytes: number;
  readonly requests: number;
  /** How many keys one call of `getMany` should ask for. */
  readonly batchKeys: number;
  /** Address of the events that tell of new generations; null: nobody tells. Known once the manifest has been read. */
  readonly events: URL | null;
  /** Address of the sessions in which the server decides what to send; null: it does not. Known once the manifest has been read. */
  readonly stream: URL | null;
  /** What those events call the manifest that was read last; null: not known. */
  readonly tag: string | null;
  /** The manifest's text, always asked for anew. Rejects with `network`, `missing`, `aborted`, or what the kind of source adds. */
  manifest(signal: AbortSignal): Promise<string>;
  /** Asks whether the server is there, and what it offers. Rejects with `network` or `aborted`. */
  knock(signal: AbortSignal): Promise<void>;
  /** One value. Rejects with `network`, `missing`, `corrupt` or `aborted`. `fresh` passes caches by. */
  get(key: string, signal: AbortSignal, fresh?: boolean): Promise<Uint8Array>;
  /** Several values. Rejects with `network` or `aborted`. */
  getMany(keys: readonly string[], signal: AbortSignal): Promise<Found[]>;
}

/** The value. Throws `missing`, or the error of a damaged one. */
export function valueOf(found: Found, key: string): Uint8Array {
  if (!found) throw new FarfieldError("missing", "the server does not have it", key);
  if (found instanceof FarfieldError) throw found;
  return found;
}
