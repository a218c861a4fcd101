/** A worker that decodes orthoview tiles. */
import { asFarfieldError } from "../errors.js";
import { decodeTile } from "../orthoview/decode.js";
import { decodeColor } from "./color.js";
import type { DecodeAnswer, DecodeRequest } from "./messages.js";

const scope = self as unknown as {
  onmessage: (event: MessageEvent<DecodeRequest>) => void;
  postMessage(answer: DecodeAnswer, transfer?: Transferable[]): void;
};

scope.onmessage = ({ data: { id, where, bytes } }) => {
  decodeTile(bytes, where, decodeColor).then(
    (tile) => scope.postMessage({ id, tile }, [tile.pixels.buffer as ArrayBuffer]),
    (thrown: unknown) => {
      const error = asFarfieldError(thrown, where);
      scope.postMessage({ id, tag: error.tag === "network" ? "corrupt" : error.tag, what: error.what });
    },
  );
};
