/** Which way the keys that are held down push, each -1, 0 or 1. */
export interface Push {
  readonly forward: number;
  readonly right: number;
  readonly up: number;
  readonly turn: number;
  readonly tilt: number;
  readonly fast: boolean;
}

/** Keys by their place on the keyboard, so that other layouts fly alike. */
export class Keys {
  private readonly held = new Set<string>();

  constructor(signal: AbortSignal) {
    addEventListener("keydown", (event) => this.down(event), { signal });
    addEventListener("keyup", ({ code }) => this.held.delete(code), { signal });
    addEventListener("blur", () => this.held.clear(), { signal });
  }

  state(): Push {
    const pair = (plus: string, minus: string): number => Number(this.held.has(plus)) - Number(this.held.has(minus));
    return {
      forward: pair("KeyW", "KeyS"),
      right: pair("KeyD", "KeyA"),
      up: pair("KeyE", "KeyQ"),
      turn: pair("ArrowRight", "ArrowLeft"),
      tilt: pair("ArrowUp", "ArrowDown"),
      fast: this.held.has("ShiftLeft") || this.held.has("ShiftRight"),
    };
  }

  private down({ code, target, ctrlKey, metaKey, altKey }: KeyboardEvent): void {
    const typing = target instanceof HTMLElement && target.matches("input, select, textarea, button");
    if (!typing && !ctrlKey && !metaKey && !altKey) this.held.add(code);
  }
}
