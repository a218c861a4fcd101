import type { Connection } from "../core/backoff.js";
import type { FarfieldError } from "../core/errors.js";

const TITLES: Readonly<Partial<Record<FarfieldError["tag"], string>>> = {
  "not-a-world": "There is no world here",
  version: "This world was made by a newer farfield",
  "no-ranges": "This server cannot send parts of a file",
  unsupported: "This browser cannot show the world",
  corrupt: "The world is damaged",
};

/** What stands over the picture when something is wrong, and the line at its top while the server is away. */
export class Messages {
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

  /** Says that the server is away, counting down to the next attempt, or that all is well again. */
  connection(state: Connection): void {
    this.clearBanner();
    // One failure in a row may be chance; the second attempt comes half a second later.
    if (state.online || state.failures < 2) return;
    const say = (): void => {
      const seconds = Math.max(0, Math.ceil((state.retryAt - performance.now()) / 1000));
      const button = element("button", "Try now");
      button.addEventListener("click", this.retry);
      const text = seconds > 0 ? `The server does not answer. Next try in ${seconds} s.` : "The server does not answer. Trying …";
      this.banner.replaceChildren(text, button);
    };
    say();
    this.banner.hidden = false;
    this.timer = setInterval(say, 500);
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
