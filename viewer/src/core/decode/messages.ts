import type { ErrorTag } from "../errors.js";
import type { DecodedTile } from "../orthoview/decode.js";

/** To a decoding worker; `bytes` are transferred. */
export interface DecodeRequest {
  readonly id: number;
  readonly where: string;
  readonly bytes: Uint8Array;
}

/** Back from it; the pixels are transferred. */
export type DecodeAnswer =
  | { readonly id: number; readonly tile: DecodedTile }
  | { readonly id: number; readonly tag: ErrorTag; readonly what: string };
