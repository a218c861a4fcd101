import type { DecodedBlockMap } from "../blockmap/decode.js";
import type { ErrorTag } from "../errors.js";
import type { DecodedTile } from "../orthoview/decode.js";
import type { Level } from "./levels.js";

/** What workers decode, by kind. */
export interface Decoded {
  readonly orthoview: DecodedTile;
  /** An orthoview of which no pixels are joined. */
  readonly splats: DecodedTile;
  /** An image with holes, in all its sizes. */
  readonly cutout: readonly Level[];
  readonly blockmap: DecodedBlockMap;
}

/** Metres of a cell along x and y. */
export type Extent = readonly [number, number];

/** To a decoding worker; `bytes` are transferred. */
export interface DecodeRequest {
  readonly id: number;
  readonly kind: keyof Decoded;
  readonly where: string;
  readonly bytes: Uint8Array;
  /** Of a BlockMap: metres of its cell along x and y. */
  readonly extent?: Extent | undefined;
}

/** Back from it; pixels are transferred. */
export type DecodeAnswer =
  | { readonly id: number; readonly decoded: Decoded[keyof Decoded] }
  | { readonly id: number; readonly tag: ErrorTag; readonly what: string };
