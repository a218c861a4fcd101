import type { FarfieldError } from "../core/errors.js";
import type { FarfieldEvents } from "../three/world.js";

type Connection = FarfieldEvents["connection"];

const TITLES: Readonly<Partial<Record<FarfieldError["tag"], string>>> = {
  "not-a-world": "There is no world here",
  version: "This world was made by a newer farfield",
  "no-ranges": "This server cannot send parts of a file",
  unsupported: "This browser cannot show the world",
  corrupt: "The world is damaged",
};

/** What stands over the picture when something is wrong, and the line at its top while the server is away. */
export class Messages {
  /** The servers that are away, each by the address of its part. */
  private readonly away = new Map<string | null, Connection>();
  private timer: ReturnType<typeof setInterval> | undefined;

  constructor(
    private readonly message: HTMLElement,
    private readonly banner: HTMLElement,
    private readonly retry: () => void,
  ) {}

  /** Says why there is nothing to see. */
  fail(error: FarfieldError): void {
    this.clearBanner();
    const title = element("h1", TITLES[error.tag] ?? "The world cannot be shown");
    this.message.replaceChildren(title, element("p", error.what), element("p", error.where), element("p", error.hint));
    this.message.hidden = false;
  }

  /** Says that the world is being opened; `null` when it is. */
  opening(address: string | null): void {
    this.message.hidden = address === null;
    if (address !== null) this.message.replaceChildren(element("h1", "Opening the world …"), element("p", address));
  }

  /** Says that a server is away, counting down to the next attempt, or that all is well again. */
  connection(state: Connection): void {
    this.clearBanner();
    // One failure in a row may be chance; the second attempt comes half a second later.
    if (state.online || state.failures < 2) this.away.delete(state.part);
    else {
      if (state.part !== null && !this.away.has(state.part)) {
        console.warn(`farfield: ${state.part} does not answer; what it has is shown coarser until it does`);
      }
      this.away.set(state.part, state);
    }
    if (this.away.size === 0) return;
    this.say();
    this.banner.hidden = false;
    this.timer = setInterval(() => this.say(), 500);
  }

  /** Says who is away: the server of the world, or else those of its parts. */
  private say(): void {
    const states = this.away.has(null) ? [this.away.get(null)!] : [...this.away.values()];
    const due = Math.min(...states.map(({ retryAt }) => retryAt));
    const seconds = Math.max(0, Math.ceil((due - performance.now()) / 1000));
    const hosts = states.map(({ part }) => part && new URL(part).host).filter(Boolean);
    const who = hosts.length === 0 ? "The server does" : `${hosts.join(", ")} ${hosts.length === 1 ? "does" : "do"}`;
    const button = element("button", "Try now");
    button.addEventListener("click", this.retry);
    this.banner.replaceChildren(`${who} not answer. ${seconds > 0 ? `Next try in ${seconds} s.` : "Trying …"}`, button);
  }

  private clearBanner(): void {
    clearInterval(this.timer);
    this.banner.hidden = true;
  }
}

function element(name: string, text: string): HTMLElement {
  const made = document.createElement(name);
  made.textContent = text;
  return made;
}
