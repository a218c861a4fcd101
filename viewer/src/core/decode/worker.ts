/** A worker that decodes tiles and images. */
import { asFarfieldError } from "../errors.js";
import { buffersOf, decode } from "./decode.js";
import type { DecodeAnswer, DecodeRequest } from "./messages.js";

const scope = self as unknown as {
  onmessage: (event: MessageEvent<DecodeRequest>) => void;
  postMessage(answer: DecodeAnswer, transfer?: Transferable[]): void;
};

scope.onmessage = ({ data: request }) => {
  const { id, where } = request;
  decode(request).then(
    (decoded) => scope.postMessage({ id, decoded }, buffersOf(decoded)),
    (thrown: unknown) => {
      const error = asFarfieldError(thrown, where);
      scope.postMessage({ id, tag: error.tag === "network" ? "corrupt" : error.tag, what: error.what });
    },
  );
};
