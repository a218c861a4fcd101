import { describe, expect, it } from "vitest";
import { FadeClock } from "../src/core/fadeclock.js";

/** What is left of the picture shown first, frame by frame: `fresh` frames that are drawn anew, then others that are not. */
function left(times: readonly number[], fresh: number, seconds: number): number[] {
  const clock = new FadeClock();
  clock.weight(0, true, seconds);
  let share = 1;
  return times.map((time, n) => (share *= 1 - clock.weight(time, n < fresh, seconds)));
}

const upTo = (end: number, step: number): number[] => Array.from({ length: Math.round(end / step) }, (_, n) => (n + 1) * step);

describe("what is shown before", () => {
  it("falls by the same law whatever the frame rate", () => {
    const [slow, fast] = [left(upTo(240, 60), 99, 0.6), left(upTo(240, 10), 99, 0.6)];
    expect(slow.at(-1)).toBeCloseTo(Math.exp(-240 / 200), 2);
    expect(fast.at(-1)).toBeCloseTo(slow.at(-1)!, 2);
  });

  it("is gone for good when a picture has stayed so long", () => {
    const shares = left(upTo(800, 50), 1, 0.5);
    expect(shares.every((share, n) => n === 0 || share <= shares[n - 1]!)).toBe(true);
    expect(shares[3]).toBeGreaterThan(0);
    expect(shares[10]).toBe(0);
  });

  it("is gone at once after a pause, and without fading", () => {
    expect(left([700], 1, 0.5)).toEqual([0]);
    expect(left([10], 1, 0)).toEqual([0]);
  });

  it("tells whether it is to be seen still", () => {
    const clock = new FadeClock();
    expect(clock.fading).toBe(false);
    clock.weight(0, true, 0.5);
    expect(clock.fading).toBe(false);
    clock.weight(100, true, 0.5);
    expect(clock.fading).toBe(true);
    clock.weight(300, false, 0.5);
    expect(clock.fading).toBe(true);
    clock.weight(600, false, 0.5);
    expect(clock.fading).toBe(false);
  });
});
