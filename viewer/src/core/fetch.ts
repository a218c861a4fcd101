import { FarfieldError } from "./errors.js";
import { Http, type Answer } from "./http.js";
import type { Found, Source } from "./source.js";

const MISSING = 0xffffffff;
/** A server that is there answers a knock sooner. */
const KNOCK_MS = 5000;
/** Most keys one request asks for: an address stays under 8,000 characters. */
export const BATCH_KEYS = 48;

/** Reads the values of a world from a folder on a web server. */
export class Fetcher implements Source {
  /** Address of the batch request, when the server offers one. */
  private batch: string | null = null;
  events: URL | null = null;
  stream: URL | null = null;
  tag: string | null = null;
  private readonly http = new Http();
  private readonly knocker = new Http(KNOCK_MS);

  constructor(
    /** Address of the folder that holds world.json, with a slash at its end. */
    readonly base: string,
  ) {}

  get bytes(): number {
    return this.http.bytes;
  }

  get requests(): number {
    return this.http.requests + this.knocker.requests;
  }

  /** How many keys one request may ask for. */
  get batchKeys(): number {
    return this.batch === null ? 1 : BATCH_KEYS;
  }

  /** The manifest's text, always asked for anew. Rejects with `network`, `missing` or `aborted`. */
  async manifest(signal: AbortSignal): Promise<string> {
    const { headers, bytes } = await this.request("world.json", signal, { cache: "no-cache" });
    this.learn(headers);
    this.tag = tagIn(headers.get("ETag"));
    return new TextDecoder().decode(bytes);
  }

  async knock(signal: AbortSignal): Promise<void> {
    try {
      const { headers } = await this.knocker.request(new URL("world.json", this.base), "world.json", signal, { method: "HEAD", cache: "no-store" });
      this.learn(headers);
    } catch (error) {
      // Without a manifest, or without HEAD, it is a server all the same.
      if (!(error instanceof FarfieldError && error.tag === "missing")) throw error;
    }
  }

  /** One value. Rejects with `network`, `missing` or `aborted`. `fresh` passes caches by. */
  async get(key: string, signal: AbortSignal, fresh = false): Promise<Uint8Array> {
    return (await this.request(key, signal, fresh ? { cache: "reload" } : {})).bytes;
  }

  /** Several values in one request; null where the server has none. Rejects with `network` or `aborted`. */
  async getMany(keys: readonly string[], signal: AbortSignal): Promise<Found[]> {
    if (this.batch === null || keys.length === 1) return Promise.all(keys.map((key) => this.getOrNull(key, signal)));
    const path = `${this.batch}?${keys.map((key) => `key=${key}`).join("&")}`;
    const { bytes } = await this.request(path, signal, {});
    return unpack(bytes, keys, path);
  }

  private learn(headers: Headers): void {
    this.batch = offered(headers, "Farfield-Batch");
    this.events = this.addressOf(offered(headers, "Farfield-Events"));
    this.stream = this.addressOf(offered(headers, "Farfield-Stream"));
    // http becomes ws, https wss.
    if (this.stream) this.stream.protocol = this.stream.protocol.replace("http", "ws");
  }

  private addressOf(path: string | null): URL | null {
    return path === null ? null : new URL(path, this.base);
  }

  private getOrNull(key: string, signal: AbortSignal): Promise<Uint8Array | null> {
    return this.get(key, signal).catch((error: unknown) => {
      if (error instanceof FarfieldError && error.tag === "missing") return null;
      throw error;
    });
  }

  private request(path: string, signal: AbortSignal, init: RequestInit): Promise<Answer> {
    return this.http.request(new URL(path, this.base), path, signal, init);
  }
}

/** The relative address of something that the server can do besides; null: it cannot. */
function offered(headers: Headers, name: string): string | null {
  const address = headers.get(name);
  return address && /^[a-z]+$/.test(address) ? address : null;
}

/** The tag that an ETag of `farfield serve` holds, compressed, weakened by a proxy or neither; null: it is another server's. */
export function tagIn(etag: string | null): string | null {
  return /^(?:W\/)?"([0-9a-f]{16})(?:-gz)?"$/.exec(etag ?? "")?.[1] ?? null;
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
