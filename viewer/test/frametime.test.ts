import { describe, expect, it } from "vitest";
import { FrameTimeControl, REST_MS } from "../src/core/frametime.js";
import { MOST_REDUCTION, reduced, REDUCTION_STEP } from "../src/core/reduction.js";

const ASKED = { supersampling: 2, views: null, leastGain: 10, layers: 2, bias: 0, other: "stays" };

/** A card that takes so long for a frame with all that is asked for, of which `fixed` whatever is drawn. */
interface Card {
  readonly splats: number;
  readonly pixels: number;
  readonly fixed: number;
}

function frameOf({ splats, pixels, fixed }: Card, reduction: number): number {
  const { supersampling, leastGain, layers, bias } = reduced(ASKED, reduction);
  const share = (10 / leastGain) ** 0.5 * (layers / 2) ** 0.5 * 4 ** -bias;
  return fixed + splats * share * (supersampling < 1 ? supersampling : 1) + pixels * (supersampling / 2) ** 2;
}

interface Flown {
  readonly times: number[];
  readonly levels: number[];
}

/** A flight of frames, of which the card tells `lag` frames later, noisier or not. */
function fly(control: FrameTimeControl, card: (n: number) => Card, { frames = 300, lag = 2, noise = 0 } = {}): Flown {
  const [times, levels]: [number[], number[]] = [[], []];
  let now = 0;
  for (let n = 0; n < frames; n++) {
    control.moved(now);
    levels.push(control.reduction(now));
    const wobble = 1 + noise * Math.sin(n * 12.9898 * n);
    times.push(frameOf(card(n), levels[n]!) * wobble);
    now += times[n]!;
    if (n >= lag) control.measured(times[n - lag]!, levels[n - lag]!);
  }
  return { times, levels };
}

const changes = (levels: readonly number[]): number => levels.filter((level, n) => n > 0 && level !== levels[n - 1]).length;
const median = (list: readonly number[]): number => [...list].sort((a, b) => a - b)[list.length >> 1]!;
const SLOW_CARD: Card = { splats: 150, pixels: 60, fixed: 8 };

it("what is wanted whole is not drawn as less right after", () => {
  const control = new FrameTimeControl(40);
  control.moved(0);
  control.measured(400, 0);
  expect(control.reduction(10)).toBeGreaterThan(0);
  control.rests();
  expect(control.reduction(20)).toBe(0);
  control.moved(30);
  expect(control.reduction(30)).toBeGreaterThan(0);
});

describe("frame time", () => {
  it.each([0, 1, 3])("comes near the target within a dozen frames and stays, told %s frames late", (lag) => {
    const { times, levels } = fly(new FrameTimeControl(40), () => SLOW_CARD, { lag });
    expect(times[0]).toBeGreaterThan(200);
    expect(Math.max(...times.slice(12 + 3 * lag))).toBeLessThan(40 * 1.6);
    expect(median(times.slice(30))).toBeLessThan(40 * 1.15);
    expect(median(times.slice(100))).toBeGreaterThan(40 * 0.3);
    expect(changes(levels.slice(100))).toBeLessThan(16);
  });

  it("does not swing where one step of less is far more than needed", () => {
    // From 2 x 2 samples to 1 x 1 this card goes from 60 ms to 18.
    const { levels } = fly(new FrameTimeControl(40), () => ({ splats: 2, pixels: 56, fixed: 2 }), { frames: 600 });
    expect(changes(levels.slice(50))).toBeLessThan(30);
    expect(changes(levels.slice(300))).toBeLessThan(12);
  });

  it("is not shaken by noise", () => {
    const { times, levels } = fly(new FrameTimeControl(40), () => SLOW_CARD, { noise: 0.12 });
    expect(median(times.slice(30))).toBeLessThan(40 * 1.15);
    expect(changes(levels.slice(50))).toBeLessThan(60);
  });

  it("follows a scene that grows heavier and lighter again", () => {
    const heavy = { ...SLOW_CARD, splats: 600 };
    const light: Card = { splats: 6, pixels: 4, fixed: 2 };
    const { times, levels } = fly(new FrameTimeControl(40), (n) => (n < 100 ? SLOW_CARD : n < 200 ? heavy : light), { frames: 800 });
    expect(median(times.slice(130, 200))).toBeLessThan(40 * 1.6);
    expect(levels[199]).toBeGreaterThan(levels[99]!);
    expect(levels.at(-1)).toBe(0);
  });

  it("leaves a fast card alone, does its utmost on a hopeless one, and is off at 0", () => {
    const fast = fly(new FrameTimeControl(40), () => ({ splats: 10, pixels: 5, fixed: 1 }));
    expect(Math.max(...fast.levels)).toBe(0);
    const hopeless = fly(new FrameTimeControl(40), () => ({ splats: 9000, pixels: 900, fixed: 90 }));
    expect(hopeless.levels.at(-1)).toBe(MOST_REDUCTION);
    const off = fly(new FrameTimeControl(0), () => SLOW_CARD);
    expect(Math.max(...off.levels)).toBe(0);
  });

  it("reduces nothing at rest, and the next motion begins as the last one ended", () => {
    const control = new FrameTimeControl(40);
    const { levels } = fly(control, () => SLOW_CARD);
    const later = 1e9;
    expect(control.reduction(later)).toBe(0);
    control.moved(later);
    expect(Math.abs(control.reduction(later) - levels.at(-1)!)).toBeLessThan(1);
    expect(control.moving(later + REST_MS - 1)).toBe(true);
    expect(control.reduction(later + REST_MS)).toBe(0);
  });

  it("learns from a slow frame at rest before anything has moved", () => {
    const control = new FrameTimeControl(40);
    control.measured(640, 0);
    control.moved(0);
    expect(control.reduction(0)).toBeGreaterThan(2);
  });
});

describe("reduction", () => {
  it("takes away little by little, never gives, and nothing at 0", () => {
    expect(reduced(ASKED, 0)).toBe(ASKED);
    let last = reduced(ASKED, 0);
    for (let level = REDUCTION_STEP; level <= MOST_REDUCTION; level += REDUCTION_STEP) {
      const next = reduced(ASKED, level);
      expect(next.supersampling).toBeLessThanOrEqual(last.supersampling);
      expect(next.leastGain).toBeGreaterThanOrEqual(last.leastGain);
      expect(next.layers).toBeLessThanOrEqual(last.layers);
      expect(next.bias).toBeGreaterThanOrEqual(last.bias);
      expect(next.bias - last.bias).toBeLessThanOrEqual(0.25);
      expect(next.other).toBe("stays");
      last = next;
    }
    expect(last).toMatchObject({ supersampling: 0.5, leastGain: 40, layers: 1, bias: 1, views: null });
    expect(reduced({ ...ASKED, views: 5 }, MOST_REDUCTION).views).toBe(2);
    expect(reduced({ ...ASKED, supersampling: 4 }, 0.5).supersampling).toBe(2);
  });
});
