/** After a refusal (too many listeners) it tries again; broken connections are the browser's own business. */
const REFUSED_MS = 30_000;

/**
 * Hears of new generations by server-sent events (spec/http.md), while the page is in sight: a browser opens at most six
 * connections to a server, so that hidden pages that listen would leave none for tiles. Whoever begins to listen is told
 * of the present manifest, so nothing is missed.
 */
export class Follower {
  private stream: EventSource | null = null;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private readonly looked = (): void => this.look();

  constructor(
    private readonly address: URL,
    /** Takes the tag of a manifest (`Source.tag`). */
    private readonly heard: (tag: string) => void,
  ) {
    globalThis.document?.addEventListener("visibilitychange", this.looked);
    this.look();
  }

  close(): void {
    globalThis.document?.removeEventListener("visibilitychange", this.looked);
    this.stop();
  }

  private look(): void {
    if (globalThis.document?.hidden) this.stop();
    else if (!this.stream) this.listen();
  }

  private listen(): void {
    clearTimeout(this.timer);
    const stream = new EventSource(this.address);
    this.stream = stream;
    stream.addEventListener("generation", ({ data }: MessageEvent<string>) => {
      const tag = tagOf(data);
      if (tag !== null) this.heard(tag);
    });
    stream.addEventListener("error", () => {
      // 2 is CLOSED: the server has refused, and the browser does not try again.
      if (stream.readyState !== 2 || this.stream !== stream) return;
      this.stop();
      this.timer = setTimeout(this.looked, REFUSED_MS);
    });
  }

  private stop(): void {
    clearTimeout(this.timer);
    this.stream?.close();
    this.stream = null;
  }
}

function tagOf(text: string): string | null {
  try {
    const { manifest } = JSON.parse(text) as { manifest?: unknown };
    return typeof manifest === "string" ? manifest : null;
  } catch {
    return null;
  }
}
