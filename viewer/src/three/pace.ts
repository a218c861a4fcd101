import { FrameTimeControl, REST_MS } from "../core/frametime.js";
import { reduced } from "../core/reduction.js";
import { FrameTimer } from "./frametimer.js";
import type { WorldOptions } from "./options.js";

/** Draws as much less of a moving picture as the times of its frames ask for, and everything of one at rest. */
export class Pace {
  /** How much less is drawn now, 0 to 5. */
  reduction = 0;
  /** What is asked for, less that. */
  options: WorldOptions;
  private readonly control: FrameTimeControl;
  private timer: FrameTimer | null = null;
  private rest: ReturnType<typeof setTimeout> | undefined;

  /** rested: told when it is time to draw everything again. */
  constructor(
    private asked: WorldOptions,
    private readonly rested: () => void,
  ) {
    this.options = asked;
    this.control = new FrameTimeControl(asked.frameMs);
  }

  /** Takes what is asked for. */
  ask(asked: WorldOptions): void {
    this.asked = asked;
    this.control.targetMs = asked.frameMs;
    this.options = reduced(asked, this.reduction);
  }

  /** Measures the frames of another card. */
  meet(gl: WebGL2RenderingContext): void {
    this.timer = new FrameTimer(gl);
  }

  /** The camera has moved. */
  moved(now: number): void {
    this.control.moved(now);
  }

  /** Decides for the next frame, `all` for all that is asked for; returns whether anything is different. */
  advance(now: number, all: boolean): boolean {
    // Or the whole picture would be followed by a lesser one and then by itself again.
    if (all) this.control.rests();
    const reduction = this.control.reduction(now);
    if (reduction > 0) {
      clearTimeout(this.rest);
      this.rest = setTimeout(this.rested, REST_MS);
    }
    if (reduction === this.reduction) return false;
    this.reduction = reduction;
    this.options = reduced(this.asked, reduction);
    return true;
  }

  /** All of a frame that began at `start` has been submitted. */
  submitted(start: number): void {
    const { reduction } = this;
    this.timer?.submitted(start, (milliseconds) => this.control.measured(milliseconds, reduction));
  }

  dispose(): void {
    clearTimeout(this.rest);
  }
}
