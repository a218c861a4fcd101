import { asFarfieldError } from "../errors.js";
import { broken, readMessage, readPiece, VERSION, type ViewMessage } from "./messages.js";

/** Milliseconds between two acknowledgements: a server takes 100 messages a second, and a fast link brings more pieces. */
const ACK_MS = 20;
/** The most that a value may have, so that a server cannot fill the memory. */
const MOST_VALUE_BYTES = 256 << 20;

/** What a session brings. */
export interface ConnectionEvents {
  readonly welcome: (generation: number) => void;
  /** A value of so many bytes follows. */
  readonly begun: (key: string, bytes: number) => void;
  /** So many bytes of it have come. */
  readonly came: (key: string, bytes: number) => void;
  readonly whole: (key: string, value: Uint8Array) => void;
  /** The rest of it does not come. */
  readonly cancelled: (key: string) => void;
  readonly missing: (key: string) => void;
  /** The server knows of nothing more to send. */
  readonly idle: () => void;
  /** It is over; nothing is said afterwards. */
  readonly ended: (why: string, code?: number) => void;
}

/** A value of which not all has come. */
interface Coming {
  readonly number: number;
  readonly key: string;
  readonly bytes: number;
  readonly parts: Uint8Array[];
  come: number;
}

export interface Hello {
  readonly generation: number;
  /** Empty: none. */
  readonly token: string;
  readonly holds: readonly string[];
}

/** One session, from its beginning to its end: acknowledges pieces and puts values together (spec/stream.md). */
export class Connection {
  /** Bytes that have come. */
  bytes = 0;
  private readonly socket: WebSocket;
  private coming: Coming | null = null;
  private pieces = 0;
  private acknowledged = 0;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private over = false;

  constructor(address: URL, hello: () => Hello, private readonly events: ConnectionEvents) {
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.addEventListener("open", () => {
      const { token, ...rest } = hello();
      this.say("hello", { version: VERSION, ...rest, ...(token && { token }) });
    });
    this.socket.addEventListener("message", ({ data }: MessageEvent<string | ArrayBuffer>) => this.hear(data));
    this.socket.addEventListener("error", () => this.end("no session"));
    this.socket.addEventListener("close", ({ reason, code }) => this.end(reason || "the server has ended the session", code));
  }

  view(view: ViewMessage): void {
    this.say("view", view);
  }

  add(keys: readonly string[]): void {
    this.say("add", { keys });
  }

  drop(keys: readonly string[]): void {
    this.say("drop", { keys });
  }

  /** Ends it, without an event. */
  close(): void {
    this.over = true;
    clearTimeout(this.timer);
    this.socket.close();
  }

  private say(type: string, members: object): void {
    // 1 is OPEN: what is said to one that is closing would be lost anyway.
    if (this.socket.readyState === 1) this.socket.send(JSON.stringify({ type, ...members }));
  }

  private end(why: string, code?: number): void {
    if (this.over) return;
    this.close();
    this.events.ended(why, code);
  }

  private hear(data: string | ArrayBuffer): void {
    if (this.over) return;
    try {
      if (typeof data === "string") this.take(data);
      else this.takePiece(data);
    } catch (thrown) {
      this.end(asFarfieldError(thrown, "stream").what);
    }
  }

  private take(text: string): void {
    this.bytes += text.length;
    const message = readMessage(text);
    switch (message?.type) {
      case "welcome":
        return this.events.welcome(message.generation);
      case "value":
        return this.begin(message.number, message.key, message.bytes);
      case "cancelled": {
        const { key } = this.expected(message.number);
        this.coming = null;
        return this.events.cancelled(key);
      }
      case "missing":
        return this.events.missing(message.key);
      case "idle":
        return this.events.idle();
    }
  }

  private begin(number: number, key: string, bytes: number): void {
    if (this.coming) throw broken("a value begins before the last one has ended");
    if (bytes > MOST_VALUE_BYTES) throw broken("a value is too large");
    this.events.begun(key, bytes);
    this.coming = { number, key, bytes, parts: [], come: 0 };
    this.finish(this.coming);
  }

  private takePiece(message: ArrayBuffer): void {
    this.bytes += message.byteLength;
    const { number, offset, part } = readPiece(message);
    const value = this.expected(number);
    if (offset !== value.come || offset + part.length > value.bytes) throw broken("a piece of a value does not fit");
    this.pieces++;
    this.acknowledge();
    value.parts.push(part);
    value.come += part.length;
    this.events.came(value.key, part.length);
    this.finish(value);
  }

  private expected(number: number): Coming {
    if (this.coming?.number !== number) throw broken("the server goes on with a value that it has not begun");
    return this.coming;
  }

  private finish({ key, parts, bytes, come }: Coming): void {
    if (come < bytes) return;
    this.coming = null;
    this.events.whole(key, joined(parts, bytes));
  }

  /** At once; those that come soon after together. */
  private acknowledge(): void {
    if (this.timer !== undefined || this.acknowledged === this.pieces) return;
    this.acknowledged = this.pieces;
    this.say("ack", { pieces: this.pieces });
    this.timer = setTimeout(() => {
      this.timer = undefined;
      this.acknowledge();
    }, ACK_MS);
  }
}

function joined(parts: readonly Uint8Array[], bytes: number): Uint8Array {
  const [first] = parts;
  if (parts.length === 1) return first!;
  const whole = new Uint8Array(bytes);
  let at = 0;
  for (const part of parts) {
    whole.set(part, at);
    at += part.length;
  }
  return whole;
}
