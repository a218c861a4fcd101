const FIRST_MS = 500;
const LONGEST_MS = 15_000;

/** State of the connection, for people. */
export interface Connection {
  readonly online: boolean;
  /** Failures in a row. */
  readonly failures: number;
  /** When the next attempt is due (performance.now). */
  readonly retryAt: number;
  readonly message: string;
}

/** Waits longer after each failure in a row: 0.5 s, 1 s, 2 s … 15 s. */
export class Backoff {
  /** Failures in a row. */
  failures = 0;
  private retryAt = 0;

  constructor(
    private readonly now: () => number,
    private readonly changed: (connection: Connection) => void,
  ) {}

  /** Milliseconds until the next attempt may start; 0: now. */
  get wait(): number {
    return this.failures === 0 ? 0 : Math.max(0, this.retryAt - this.now());
  }

  /** Fulfilled when the next attempt may start. */
  rest(): Promise<void> {
    return new Promise((resolve) => {
      const look = (): void => {
        if (this.wait === 0) resolve();
        else setTimeout(look, Math.min(this.wait, 250));
      };
      look();
    });
  }

  failed(message: string): void {
    // Requests that were under way together fail together: that is one failure.
    if (this.wait > 0) return;
    this.failures++;
    this.retryAt = this.now() + Math.min(LONGEST_MS, FIRST_MS * 2 ** (this.failures - 1));
    this.changed({ online: false, failures: this.failures, retryAt: this.retryAt, message });
  }

  succeeded(): void {
    if (this.failures === 0) return;
    this.failures = 0;
    this.changed({ online: true, failures: 0, retryAt: 0, message: "" });
  }

  /** The server is there again; the failures are remembered until it has done what was asked of it. */
  reached(): void {
    if (this.failures > 0) this.changed({ online: true, failures: 0, retryAt: 0, message: "" });
  }

  /** Lets the next attempt start at once. */
  hurry(): void {
    this.retryAt = 0;
  }
}
