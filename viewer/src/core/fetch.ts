import { asFarfieldError, FarfieldError } from "./errors.js";

/** Without an answer for this long, a request counts as failed. */
const TIMEOUT_MS = 30_000;
const MISSING = 0xffffffff;
/** Most keys one request asks for: an address stays under 8,000 characters. */
export const BATCH_KEYS = 48;

/** Reads the values of a world from a web server. Counts what comes in. */
export class Fetcher {
  /** Address of the batch request, when the server offers one. */
  private batch: string | null = null;
  /** Bytes and requests since the start. */
  bytes = 0;
  requests = 0;

  constructor(
    /** Address of the folder that holds world.json, with a slash at its end. */
    readonly base: string,
  ) {}

  /** How many keys one request may ask for. */
  get batchKeys(): number {
    return this.batch === null ? 1 : BATCH_KEYS;
  }

  /** The manifest's text, always asked for anew. Rejects with `network`, `missing` or `aborted`. */
  async manifest(signal: AbortSignal): Promise<string> {
    const { headers, bytes } = await this.request("world.json", signal, { cache: "no-cache" });
    const batch = headers.get("Farfield-Batch");
    this.batch = batch && /^[a-z]+$/.test(batch) ? batch : null;
    return new TextDecoder().decode(bytes);
  }

  /** One value. Rejects with `network`, `missing` or `aborted`. `fresh` passes caches by. */
  async get(key: string, signal: AbortSignal, fresh = false): Promise<Uint8Array> {
    return (await this.request(key, signal, fresh ? { cache: "reload" } : {})).bytes;
  }

  /** Several values in one request; null where the server has none. Rejects with `network` or `aborted`. */
  async getMany(keys: readonly string[], signal: AbortSignal): Promise<(Uint8Array | null)[]> {
    if (this.batch === null || keys.length === 1) return Promise.all(keys.map((key) => this.getOrNull(key, signal)));
    const path = `${this.batch}?${keys.map((key) => `key=${key}`).join("&")}`;
    const { bytes } = await this.request(path, signal, {});
    return unpack(bytes, keys, path);
  }

  private getOrNull(key: string, signal: AbortSignal): Promise<Uint8Array | null> {
    return this.get(key, signal).catch((error: unknown) => {
      if (error instanceof FarfieldError && error.tag === "missing") return null;
      throw error;
    });
  }

  private async request(path: string, signal: AbortSignal, init: RequestInit): Promise<Answer> {
    this.requests++;
    const timed = timeLimit(signal);
    try {
      const answer = await fetch(new URL(path, this.base), { ...init, signal: timed.signal });
      if (!answer.ok) throw refusal(answer.status, path);
      const bytes = new Uint8Array(await answer.arrayBuffer());
      this.bytes += bytes.length;
      return { headers: answer.headers, bytes };
    } catch (error) {
      throw signal.aborted ? new FarfieldError("aborted", "no longer wanted", path) : network(error, path);
    } finally {
      timed.clear();
    }
  }
}

interface Answer {
  readonly headers: Headers;
  readonly bytes: Uint8Array;
}

/** Most refusals last; time-outs, too many requests and the server's own troubles pass. */
function refusal(status: number, path: string): FarfieldError {
  const passing = status >= 500 || status === 408 || status === 429;
  return new FarfieldError(passing ? "network" : "missing", `the server answers ${status}`, path);
}

/** Anything but the caller's own abort is the network's fault, a time limit included. */
function network(error: unknown, path: string): FarfieldError {
  const known = asFarfieldError(error, path);
  return known.tag === "aborted" ? new FarfieldError("network", "no answer", path) : known;
}

/** A signal that also aborts when the time is up, and what stops the clock. */
function timeLimit(signal: AbortSignal): { signal: AbortSignal; clear: () => void } {
  const own = new AbortController();
  const abort = (): void => own.abort();
  if (signal.aborted) abort();
  signal.addEventListener("abort", abort, { once: true });
  const timer = setTimeout(abort, TIMEOUT_MS);
  const clear = (): void => {
    clearTimeout(timer);
    signal.removeEventListener("abort", abort);
  };
  return { signal: own.signal, clear };
}

/** The values in the answer to a batch request, as parts of it. Throws `network` when it is cut short. */
export function unpack(bytes: Uint8Array, keys: readonly string[], where: string): (Uint8Array | null)[] {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  let at = 0;
  return keys.map(() => {
    if (at + 4 > bytes.length) throw new FarfieldError("network", "the answer is cut short", where);
    const length = view.getUint32(at, true);
    at += 4;
    if (length === MISSING) return null;
    if (at + length > bytes.length) throw new FarfieldError("network", "the answer is cut short", where);
    at += length;
    return bytes.subarray(at - length, at);
  });
}
