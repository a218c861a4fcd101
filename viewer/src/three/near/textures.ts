import { LinearMipmapLinearFilter, RepeatWrapping, SRGBColorSpace, Texture } from "three";
import type { Fetcher } from "../../core/fetch.js";
import { FarfieldError } from "../../core/errors.js";
import { textureKey } from "../../core/keys.js";

interface Entry {
  readonly texture: Promise<Texture>;
  uses: number;
}

/** Images that several GLBs refer to, fetched once each and freed with their last user. */
export class TextureShelf {
  private readonly entries = new Map<string, Entry>();

  constructor(private readonly fetcher: Fetcher) {}

  /** The texture of an image; one `release` belongs to each. */
  acquire(hash: string): Promise<Texture> {
    const found = this.entries.get(hash) ?? { texture: this.load(hash), uses: 0 };
    found.uses++;
    this.entries.set(hash, found);
    return found.texture;
  }

  release(hash: string): void {
    const found = this.entries.get(hash);
    if (!found || --found.uses > 0) return;
    this.entries.delete(hash);
    found.texture.then(free, () => undefined);
  }

  private async load(hash: string): Promise<Texture> {
    // Without the signal of the first who asks: others may be waiting for the same image.
    const bytes = await this.fetcher.get(textureKey(hash), new AbortController().signal);
    let image: ImageBitmap;
    try {
      image = await createImageBitmap(new Blob([bytes as BlobPart]), {
        premultiplyAlpha: "none",
        colorSpaceConversion: "none",
      });
    } catch {
      throw new FarfieldError("corrupt", "the image cannot be decoded", textureKey(hash));
    }
    const texture = new Texture(image);
    texture.colorSpace = SRGBColorSpace;
    texture.flipY = false;
    texture.wrapS = texture.wrapT = RepeatWrapping;
    texture.minFilter = LinearMipmapLinearFilter;
    texture.anisotropy = 4;
    texture.needsUpdate = true;
    return texture;
  }
}

/** Bytes a texture takes with its mip levels. */
export function textureBytes(texture: Texture): number {
  const { width, height } = texture.image as ImageBitmap;
  return Math.round((width * height * 4 * 4) / 3);
}

function free(texture: Texture): void {
  (texture.image as ImageBitmap).close();
  texture.dispose();
}
