/** Measures how long the graphics card takes for a frame, without waiting for it: a fence is looked at now and then. */
export class FrameTimer {
  /** Of the frame measured last, milliseconds from the start of its making until the card was done. */
  milliseconds = 0;
  /** How many frames have been measured. */
  measured = 0;
  private running = false;

  constructor(private readonly gl: WebGL2RenderingContext) {}

  /**
   * To be called when all of a frame that began at `start` (performance.now) has been submitted; `done` is told its milliseconds, unless
   * another is being measured.
   */
  submitted(start: number, done: (milliseconds: number) => void = () => undefined): void {
    if (this.running) return;
    const fence = this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    if (!fence) return;
    this.running = true;
    this.gl.flush();
    const look = (): void => {
      const reached = this.gl.isContextLost() || this.gl.getSyncParameter(fence, this.gl.SYNC_STATUS) === this.gl.SIGNALED;
      if (!reached) return void setTimeout(look, 2);
      this.running = false;
      this.milliseconds = performance.now() - start;
      this.measured++;
      this.gl.deleteSync(fence);
      done(this.milliseconds);
    };
    setTimeout(look, 0);
  }

  /** Whether the card is still at work on the frame being measured. */
  get busy(): boolean {
    return this.running;
  }
}
