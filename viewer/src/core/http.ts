import { asFarfieldError, FarfieldError } from "./errors.js";

/** Without an answer for this long, a request counts as failed. */
const TIMEOUT_MS = 30_000;

export interface Answer {
  readonly status: number;
  readonly headers: Headers;
  readonly bytes: Uint8Array;
}

/** Asks a web server, within a time limit. Counts what comes in. */
export class Http {
  /** Bytes and requests since the start. */
  bytes = 0;
  requests = 0;

  constructor(private readonly timeout = TIMEOUT_MS) {}

  /**
   * The answer to a request that succeeds; `accept` may throw before the body is read, which is then left unread.
   * `where` is what errors call it. Rejects with `network`, `missing`, `aborted` or what `accept` throws.
   */
  async request(
    url: URL | string,
    where: string,
    signal: AbortSignal,
    init: RequestInit,
    accept: (answer: Response) => void = () => undefined,
  ): Promise<Answer> {
    this.requests++;
    const timed = timeLimit(signal, this.timeout);
    try {
      const answer = await fetch(url, { ...init, signal: timed.signal });
      if (!answer.ok) throw refusal(answer.status, where);
      accept(answer);
      const bytes = new Uint8Array(await answer.arrayBuffer());
      this.bytes += bytes.length;
      return { status: answer.status, headers: answer.headers, bytes };
    } catch (error) {
      throw signal.aborted ? new FarfieldError("aborted", "no longer wanted", where) : network(error, where);
    } finally {
      timed.end();
    }
  }
}

/** Most refusals last; time-outs, too many requests and the server's own troubles pass. */
function refusal(status: number, where: string): FarfieldError {
  const passing = status >= 500 || status === 408 || status === 429;
  return new FarfieldError(passing ? "network" : "missing", `the server answers ${status}`, where);
}

/** Anything but the caller's own abort is the network's fault, a time limit included. */
function network(error: unknown, where: string): FarfieldError {
  const known = asFarfieldError(error, where);
  return known.tag === "aborted" ? new FarfieldError("network", "no answer", where) : known;
}

/** A signal that also aborts when the time is up; `end` stops the clock, and a body that nobody has read. */
function timeLimit(signal: AbortSignal, milliseconds: number): { signal: AbortSignal; end: () => void } {
  const own = new AbortController();
  const abort = (): void => own.abort();
  if (signal.aborted) abort();
  signal.addEventListener("abort", abort, { once: true });
  const timer = setTimeout(abort, milliseconds);
  const end = (): void => {
    clearTimeout(timer);
    signal.removeEventListener("abort", abort);
    abort();
  };
  return { signal: own.signal, end };
}
