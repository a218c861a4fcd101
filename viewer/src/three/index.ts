/** farfield worlds in a three.js scene of your own. */
export { FarfieldWorld, type FarfieldEvents } from "./world.js";
export { defaultOptions, type OptionChanges, type WorldOptions } from "./options.js";
export type { Picked } from "./picker.js";
export type { Light } from "./light.js";
export type { WorldStats } from "./stats.js";
export * from "../core/index.js";
