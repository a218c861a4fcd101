/** A drag of one pointer, or of two together. */
export interface Drag {
  readonly dx: number;
  readonly dy: number;
  readonly kind: "orbit" | "look" | "pan";
  /** Since the last move when the pointer has just been let go; else 0. */
  readonly seconds: number;
}

export interface PointerUses {
  drag(drag: Drag): void;
  /** Distance times this. */
  zoom(factor: number): void;
  /** A click, or a finger put down and lifted: pixels of the page. */
  tap?(x: number, y: number): void;
}

interface Held {
  readonly x: number;
  readonly y: number;
  readonly time: number;
}

/** Letting go within this time after a move lets the turn glide on. */
const FLICK_MS = 60;

/** A pointer that goes no farther, in pixels, and is let go within this time has tapped. */
const TAP_PIXELS = 5;
const TAP_MS = 600;

/** Mouse and touch: left or one finger orbits, right looks round, middle, shift or two fingers shift; a pinch zooms. */
export class Pointers {
  private readonly held = new Map<number, Held>();
  private kind: Drag["kind"] = "orbit";
  private last = { dx: 0, dy: 0, ms: 0 };
  /** Where a pointer was put down alone that may tap still. */
  private tapping: Held | null = null;

  constructor(
    canvas: HTMLElement,
    signal: AbortSignal,
    private readonly uses: PointerUses,
  ) {
    canvas.addEventListener("contextmenu", (event) => event.preventDefault(), { signal });
    canvas.addEventListener("pointerdown", (event) => this.down(event, canvas), { signal });
    canvas.addEventListener("pointermove", (event) => this.move(event), { signal });
    for (const name of ["pointerup", "pointercancel"] as const) {
      canvas.addEventListener(name, (event) => this.up(event), { signal });
    }
  }

  private down(event: PointerEvent, canvas: HTMLElement): void {
    canvas.focus();
    canvas.setPointerCapture(event.pointerId);
    this.held.set(event.pointerId, { x: event.clientX, y: event.clientY, time: event.timeStamp });
    this.last = { dx: 0, dy: 0, ms: 0 };
    this.tapping = this.held.size === 1 && event.button === 0 && !event.shiftKey ? this.held.get(event.pointerId)! : null;
    this.kind = event.button === 2 ? "look" : event.button === 1 || event.shiftKey ? "pan" : "orbit";
  }

  private move(event: PointerEvent): void {
    const before = this.held.get(event.pointerId);
    if (!before) return;
    const now = { x: event.clientX, y: event.clientY, time: event.timeStamp };
    if (this.tapping && Math.hypot(now.x - this.tapping.x, now.y - this.tapping.y) > TAP_PIXELS) this.tapping = null;
    const [dx, dy] = [now.x - before.x, now.y - before.y];
    const other = [...this.held].find(([id]) => id !== event.pointerId)?.[1];
    this.held.set(event.pointerId, now);
    if (other) {
      const [was, is] = [before, now].map(({ x, y }) => Math.hypot(x - other.x, y - other.y));
      if (was! > 0 && is! > 0) this.uses.zoom(was! / is!);
      this.uses.drag({ dx: dx / 2, dy: dy / 2, kind: "pan", seconds: 0 });
      return;
    }
    this.last = { dx, dy, ms: now.time - before.time };
    this.uses.drag({ dx, dy, kind: this.kind, seconds: 0 });
  }

  private up(event: PointerEvent): void {
    const before = this.held.get(event.pointerId);
    this.held.delete(event.pointerId);
    const tapped = event.type === "pointerup" && this.tapping && event.timeStamp - this.tapping.time < TAP_MS;
    this.tapping = null;
    if (tapped) this.uses.tap?.(event.clientX, event.clientY);
    const { dx, dy, ms } = this.last;
    const flicked = before && this.held.size === 0 && event.timeStamp - before.time < FLICK_MS && ms > 0;
    if (flicked && this.kind === "orbit" && event.type === "pointerup") {
      this.uses.drag({ dx, dy, kind: "orbit", seconds: Math.max(ms, 8) / 1000 });
    }
    this.last = { dx: 0, dy: 0, ms: 0 };
  }
}
