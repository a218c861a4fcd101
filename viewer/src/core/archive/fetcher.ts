import { crc32 } from "../crc32.js";
import { asFarfieldError, FarfieldError } from "../errors.js";
import { Http } from "../http.js";
import { type Found, type Source } from "../source.js";
import { damaged, decodeDirectory, decodeHeader, type Entry, type Span } from "./layout.js";
import { groupSpans } from "./groups.js";
import { compareRanks, rankOf } from "./order.js";

/** What the first request brings: header, root directory, manifest, and mostly the first index tiles. */
const HEAD_BYTES = 64 << 10;
/** Directories kept; each lists a thousand values or more. */
const KEPT_DIRECTORIES = 64;
/** Few enough for requests to be given up soon, enough for neighbours to come together. */
const BATCH_KEYS = 12;

type Directory = ReadonlyMap<string, Span>;

/** An archive whose root directory has been read. */
interface Opened {
  readonly head: Uint8Array;
  readonly length: number;
  readonly root: readonly Entry[];
  /** Leaf directories by their place in the root, those used last at the end. */
  readonly leaves: Map<number, Promise<Directory>>;
}

/** Reads the values of a world from an archive (spec/archive.md) on a web server that answers byte ranges. */
export class ArchiveFetcher implements Source {
  readonly base: string;
  readonly batchKeys = BATCH_KEYS;
  /** Servers tell of folders only. */
  readonly events = null;
  readonly stream = null;
  readonly tag = null;
  private opened: Promise<Opened> | null = null;
  private readonly http = new Http();

  constructor(
    /** Address of the archive. */
    private readonly address: string,
  ) {
    this.base = `${address}/`;
  }

  get bytes(): number {
    return this.http.bytes;
  }

  get requests(): number {
    return this.http.requests;
  }

  /** Rejects with `no-ranges`, `not-a-world`, `version` and `corrupt` besides. */
  async manifest(signal: AbortSignal): Promise<string> {
    const opened = this.open(signal);
    this.opened = opened;
    opened.catch(() => (this.opened = null));
    return new TextDecoder().decode(await this.get("world.json", signal));
  }

  /** Whether the archive can be read shows when values are asked for. */
  knock(): Promise<void> {
    return Promise.resolve();
  }

  async get(key: string, signal: AbortSignal, fresh = false): Promise<Uint8Array> {
    const opened = await this.whenOpened();
    const span = await this.find(opened, key);
    if (!span) throw new FarfieldError("missing", "the archive does not have it", key);
    return this.checked(opened, span, key, signal, fresh);
  }

  async getMany(keys: readonly string[], signal: AbortSignal): Promise<Found[]> {
    const opened = await this.whenOpened();
    const spans = await Promise.all(keys.map((key) => this.find(opened, key).catch(unlessDamaged)));
    const found = new Map<Span, Found>();
    const present = spans.filter((span): span is Span => span !== null && !(span instanceof FarfieldError));
    await Promise.all(groupSpans(present).map((group) => this.readGroup(opened, group, found, signal)));
    return spans.map((span) => (span === null || span instanceof FarfieldError ? span : found.get(span)!));
  }

  private async open(signal: AbortSignal): Promise<Opened> {
    const { bytes: head, headers } = await this.range(0, HEAD_BYTES, signal, "no-cache");
    const { root, length } = decodeHeader(head, this.address);
    const total = /\/(\d+)$/.exec(headers.get("Content-Range") ?? "");
    if (total && Number(total[1]) !== length) {
      throw damaged(`the archive is cut short: ${total[1]} of ${length} bytes`, this.address);
    }
    const begun: Opened = { head, length, root: [], leaves: new Map() };
    const block = await this.checked(begun, root, this.address, signal);
    return { ...begun, root: decodeDirectory(block, length, this.address) };
  }

  private whenOpened(): Promise<Opened> {
    this.opened ??= this.open(new AbortController().signal);
    return this.opened;
  }

  /** Where a value lies; null: there is none. Rejects with `network` or `corrupt`. */
  private async find(opened: Opened, key: string): Promise<Span | null> {
    const rank = rankOf(key);
    let [low, high] = [0, opened.root.length];
    while (low < high) {
      const middle = (low + high) >> 1;
      if (compareRanks(opened.root[middle]!.rank, rank) <= 0) low = middle + 1;
      else high = middle;
    }
    if (low === 0) return null;
    return (await this.leaf(opened, low - 1)).get(key) ?? null;
  }

  private leaf(opened: Opened, number: number): Promise<Directory> {
    const { leaves } = opened;
    const known = leaves.get(number) ?? this.readLeaf(opened, number);
    leaves.delete(number);
    leaves.set(number, known);
    if (leaves.size > KEPT_DIRECTORIES) leaves.delete(leaves.keys().next().value!);
    return known;
  }

  /** Without the signal of the first who asks: others may be waiting for the same directory. */
  private readLeaf(opened: Opened, number: number): Promise<Directory> {
    const read = async (): Promise<Directory> => {
      const block = await this.checked(opened, opened.root[number]!.span, this.address, new AbortController().signal);
      const entries = decodeDirectory(block, opened.length, this.address);
      return new Map(entries.map(({ rank, span }) => [rank.key, span]));
    };
    const reading = read();
    reading.catch(() => opened.leaves.delete(number));
    return reading;
  }

  /** Reads neighbouring values with one request, into `found`. */
  private async readGroup(opened: Opened, group: readonly Span[], found: Map<Span, Found>, signal: AbortSignal): Promise<void> {
    const start = group[0]!.offset;
    const end = Math.max(...group.map(({ offset, length }) => offset + length));
    const bytes = await this.read(opened, { offset: start, length: end - start }, signal, false);
    for (const span of group) {
      const value = bytes.subarray(span.offset - start, span.offset - start + span.length);
      const whole = crc32(value) === span.checksum;
      found.set(span, whole ? value : await this.checked(opened, span, this.address, signal, true).catch(unlessDamaged));
    }
  }

  /** The bytes of a span; those that are not what was written are asked for once more, past all caches. */
  private async checked(opened: Opened, span: Span, where: string, signal: AbortSignal, fresh = false): Promise<Uint8Array> {
    const bytes = await this.read(opened, span, signal, fresh);
    if (crc32(bytes) === span.checksum) return bytes;
    if (fresh) throw damaged("the archive is damaged here: the checksum is another", where);
    return this.checked(opened, span, where, signal, true);
  }

  private async read(opened: Opened, { offset, length }: Omit<Span, "checksum">, signal: AbortSignal, fresh: boolean): Promise<Uint8Array> {
    if (!fresh && offset + length <= opened.head.length) return opened.head.subarray(offset, offset + length);
    if (length === 0) return new Uint8Array();
    return (await this.range(offset, length, signal, fresh ? "reload" : "default")).bytes;
  }

  private range(offset: number, length: number, signal: AbortSignal, cache: RequestCache) {
    const init = { cache, headers: { Range: `bytes=${offset}-${offset + length - 1}` } };
    return this.http.request(this.address, this.address, signal, init, refuseWhole);
  }
}

/** Servers may ignore `Range` and send everything; an archive may be as large as a city. */
function refuseWhole(answer: Response): void {
  if (answer.status === 206) return;
  const hint = "An archive needs a server that supports them: farfield serve, nginx, Apache, a bucket.";
  throw new FarfieldError("no-ranges", "The server does not support byte ranges.", answer.url, hint);
}

function unlessDamaged(thrown: unknown): FarfieldError {
  const error = asFarfieldError(thrown, "");
  if (error.tag === "corrupt" || error.tag === "missing") return error;
  throw error;
}
