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
  /**
   * How much of what an object lacks to the accuracy of a use it is brought nearer to it, above 0 to 1: some tiles of a cell are drawn
   * before what showed it until then.
   */
  readonly part: number;
  /** Of offers with the same, each larger one holds all that the smaller ones do. */
  readonly series: object;
}

/** What an object is shown by, wholly or in part. */
export interface Shown extends Use {
  readonly part: number;
}

/** What there is to be seen, and ways to show it; the twin of `farfield.stream.offers`. */
export interface Offering<Item> {
  /** What there is to be seen. `seconds`: for which the prediction is believed. */
  boxes(prediction: Prediction, seconds: number): readonly Box[];
  /** What is not there and could be, and how well objects are shown by what is, coarse before fine. */
  offers(outlook: Outlook): { readonly offers: readonly Offer<Item>[]; readonly shown: readonly Shown[] };
}
