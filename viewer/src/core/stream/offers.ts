import type { Box } from "../vector.js";
import type { Prediction } from "./motion.js";
import type { Outlook } from "./outlook.js";

/** An object that an item would show, and how accurately in each interval, 0 to 1. */
export interface Use {
  readonly object: number;
  readonly accuracy: readonly number[];
}

/** Something that could be sent, or asked for. */
export interface Offer<Item> {
  readonly item: Item;
  /** Bytes that are still to come. */
  readonly size: number;
  /** What it shows. */
  readonly uses: readonly Use[];
  /** How many parts of each object it shows. */
  readonly parts: number;
  /** Of offers with the same, each larger one holds all that the smaller ones do. */
  readonly series: object;
}

/** What an object is shown by, and how many parts of it. */
export interface Shown extends Use {
  readonly parts: number;
}

/**
 * What there is to see of an object is taken in parts, up to these shares of it: a cell's tiles, best first, show one part after the
 * other, and those of a finer cell the same ones first.
 */
export const SHARES = [0.25, 0.5, 0.75, 0.9, 1] as const;

/** How many parts are shown whole where so much of an object is. */
export function partsOf(share: number): number {
  return SHARES.filter((end) => share >= end - 1e-6).length;
}

/** What there is to be seen, and ways to show it; the twin of `farfield.stream.offers`. */
export interface Offering<Item> {
  /** What there is to be seen. `seconds`: for which the prediction is believed. */
  boxes(prediction: Prediction, seconds: number): readonly Box[];
  /** Factors of the benefit of each, after the last call (BEN 4.3). */
  importance(outlook: Outlook): ArrayLike<number>;
  /** What is not there and could be, and how well objects are shown by what is. */
  offers(outlook: Outlook): { readonly offers: readonly Offer<Item>[]; readonly shown: readonly Shown[] };
}
