import { corrupt, FarfieldError } from "../errors.js";

let shared: OffscreenCanvasRenderingContext2D | null = null;

/** A canvas of at least that size, kept from tile to tile: it is drawn on and read without a pause between. */
function canvasOf(width: number, height: number): OffscreenCanvasRenderingContext2D {
  if (!shared || shared.canvas.width < width || shared.canvas.height < height) {
    const [columns, rows] = [shared?.canvas.width ?? 512, shared?.canvas.height ?? 512];
    const canvas = new OffscreenCanvas(Math.max(width, columns), Math.max(height, rows));
    shared = canvas.getContext("2d", { willReadFrequently: true, alpha: false });
  }
  if (!shared) throw new FarfieldError("unsupported", "no canvas to decode colours with");
  return shared;
}

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
    const context = canvasOf(width, height);
    context.drawImage(bitmap, 0, 0);
    return context.getImageData(0, 0, width, height).data;
  } finally {
    bitmap.close();
  }
}
