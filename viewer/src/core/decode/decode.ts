import { buffersOfBlockMap, decodeBlockMap } from "../blockmap/decode.js";
import { corrupt } from "../errors.js";
import { decodeTile } from "../orthoview/decode.js";
import { joinPatches } from "../orthoview/patches.js";
import { decodeColor, decodeImage } from "./color.js";
import { maskedLevels } from "./levels.js";
import type { Decoded, DecodeRequest } from "./messages.js";

/** Decodes what a request asks for, here. Rejects with `corrupt`. */
export async function decode({ kind, bytes, where, extent }: Omit<DecodeRequest, "id">): Promise<Decoded[keyof Decoded]> {
  if (kind === "orthoview") return joinPatches(await decodeTile(bytes, where, decodeColor));
  if (kind === "splats") return decodeTile(bytes, where, decodeColor);
  if (kind === "blockmap") {
    if (!extent) throw corrupt("a BlockMap without the extent of its cell", where);
    return decodeBlockMap(bytes, where, decodeColor, extent);
  }
  const { data, width, height } = await decodeImage(bytes, where);
  return maskedLevels(data, width, height);
}

/** The buffers of what was decoded. */
export function buffersOf(decoded: Decoded[keyof Decoded]): ArrayBuffer[] {
  if ("tops" in decoded) return buffersOfBlockMap(decoded);
  if (!("pixels" in decoded)) return decoded.map(({ pixels }) => pixels.buffer as ArrayBuffer);
  const { pixels, texels, blocks } = decoded;
  return [pixels, texels, blocks.starts, blocks.boxes, blocks.cones].map(({ buffer }) => buffer as ArrayBuffer);
}
