import { corrupt, FarfieldError } from "../errors.js";

let shared: OffscreenCanvasRenderingContext2D | null = null;

/** A canvas of at least that size, kept from tile to tile: it is drawn on and read without a pause between. */
function canvasOf(width: number, height: number): OffscreenCanvasRenderingContext2D {
  if (!shared || shared.canvas.width < width || shared.canvas.height < height) {
    const [columns, rows] = [shared?.canvas.width ?? 512, shared?.canvas.height ?? 512];
    const canvas = new OffscreenCanvas(Math.max(width, columns), Math.max(height, rows));
    shared = canvas.getContext("2d", { willReadFrequently: true });
  }
  if (!shared) throw new FarfieldError("unsupported", "no canvas to decode colours with");
  return shared;
}

/**
 * Decodes an image with the browser's own decoder, without colour management, which would change the values. Works in a
 * worker. Rejects with `corrupt`.
 */
export async function decodeImage(bytes: Uint8Array, where: string): Promise<ImageData> {
  let bitmap: ImageBitmap;
  try {
    const options = { premultiplyAlpha: "none", colorSpaceConversion: "none" } as const;
    bitmap = await createImageBitmap(new Blob([bytes as BlobPart]), options);
  } catch {
    throw corrupt("the image cannot be decoded", where);
  }
  try {
    const context = canvasOf(bitmap.width, bitmap.height);
    // What was drawn before must not show through holes.
    context.clearRect(0, 0, bitmap.width, bitmap.height);
    context.drawImage(bitmap, 0, 0);
    return context.getImageData(0, 0, bitmap.width, bitmap.height);
  } finally {
    bitmap.close();
  }
}

/** The colour plane of a tile: an opaque WebP file whose size has been looked at. */
export async function decodeColor(bytes: Uint8Array, _width: number, _height: number, where: string): Promise<Uint8ClampedArray> {
  return (await decodeImage(bytes, where)).data;
}
