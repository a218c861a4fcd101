import { CLEAR_SKY, DEFAULT_SKY } from "../three/light.js";
import type { OptionChanges, WorldOptions } from "../three/options.js";
import type { Control, Toggle } from "./panel.js";

/** The haze's slider: each step halves how far one can see, from twice this many metres on; 0 is no haze. */
const CLEAREST = 100_000;

/** Where the slider of tiles stands at 0. */
const LEAST_GAIN = 10;

/** What the sliders change. */
export interface Adjustable {
  readonly world: { readonly options: WorldOptions };
  setOptions(changes: OptionChanges): void;
}

/** The sliders and boxes of the panel. */
export function controlsOf(page: Adjustable): { light: readonly (Control | Toggle)[]; quality: readonly Control[] } {
  const options = (): WorldOptions => page.world.options;
  const set = (changes: OptionChanges): void => page.setOptions(changes);
  return {
    light: [
      {
        label: "Azimuth", min: 0, max: 360, step: 1, unit: "°",
        get: () => options().light.azimuth, set: (azimuth) => set({ light: { azimuth } }),
      },
      {
        label: "Elevation", min: -10, max: 90, step: 1, unit: "°",
        get: () => options().light.elevation, set: (elevation) => set({ light: { elevation } }),
      },
      {
        label: "Ambient", min: 0, max: 1, step: 0.05,
        get: () => options().light.ambient, set: (ambient) => set({ light: { ambient } }),
      },
      {
        label: "Haze", min: 0, max: 10, step: 0.25, text: () => visibility(options().haze),
        get: () => stepOf(options().haze), set: (step) => set({ haze: step > 0 ? CLEAREST / 2 ** (step - 1) : null }),
      },
      { label: "Clear sky", on: () => options().sky === CLEAR_SKY, turn: (on) => set({ sky: on ? CLEAR_SKY : DEFAULT_SKY }) },
      { label: "Shadows", on: () => options().shadows, turn: (shadows) => set({ shadows }) },
    ],
    quality: [
      {
        label: "Samples", min: 1, max: 4, step: 1, unit: "²",
        get: () => options().supersampling, set: (supersampling) => set({ supersampling }),
      },
      // Each step is half as many pixels that a kilobyte must add.
      {
        label: "Tiles a cell", min: -3, max: 1, step: 0.5,
        get: () => -Math.log2(options().leastGain / LEAST_GAIN), set: (more) => set({ leastGain: LEAST_GAIN / 2 ** more }),
      },
      { label: "Depth layers", min: 1, max: 2, step: 1, get: () => options().layers, set: (layers) => set({ layers }) },
      {
        label: "Frame time", min: 0, max: 200, step: 10, unit: " ms",
        get: () => options().frameMs, set: (frameMs) => set({ frameMs }),
      },
      // More detail is less bias.
      { label: "Detail", min: -3, max: 2, step: 0.25, get: () => -options().bias, set: (detail) => set({ bias: -detail }) },
    ],
  };
}

function stepOf(haze: number | null): number {
  return haze === null ? 0 : Math.min(10, Math.max(0.25, 1 + Math.log2(CLEAREST / haze)));
}

function visibility(haze: number | null): string {
  if (haze === null) return "none";
  return haze < 950 ? `${Number(haze.toPrecision(2))} m` : `${Number((haze / 1000).toPrecision(2))} km`;
}
