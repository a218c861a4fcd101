import { corrupt } from "../errors.js";

/**
 * Decodes an opaque WebP file with the browser's own decoder, without premultiplication or colour management, which
 * would change the values. Works in a worker.
 */
export async function decodeColor(
  bytes: Uint8Array,
  width: number,
  height: number,
  where: string,
): Promise<Uint8ClampedArray> {
  let bitmap: ImageBitmap;
  try {
    bitmap = await createImageBitmap(new Blob([bytes as BlobPart], { type: "image/webp" }), {
      premultiplyAlpha: "none",
      colorSpaceConversion: "none",
    });
  } catch {
    throw corrupt("the colour cannot be decoded", where);
  }
  try {
    const canvas = new OffscreenCanvas(width, height);
    const context = canvas.getContext("2d", { willReadFrequently: true, alpha: false });
    if (!context) throw corrupt("no canvas to decode the colour with", where);
    context.drawImage(bitmap, 0, 0);
    return context.getImageData(0, 0, width, height).data;
  } finally {
    bitmap.close();
  }
}
