import { DataTexture, LinearFilter, LinearMipmapLinearFilter, RepeatWrapping, SRGBColorSpace, Texture } from "three";
import type { DecodePool } from "../../core/decode/pool.js";
import { FarfieldError } from "../../core/errors.js";
import { textureKey } from "../../core/keys.js";
import type { Servers } from "../../core/servers.js";

interface Entry {
  readonly texture: Promise<Texture>;
  uses: number;
}

/** Images that several GLBs refer to, fetched once each and freed with their last user. */
export class TextureShelf {
  private readonly entries = new Map<string, Entry>();

  /** anisotropy: of textures, as the card does it well. */
  constructor(
    private readonly servers: Servers,
    private readonly pool: DecodePool,
    private readonly anisotropy: () => number,
  ) {}

  /** The texture of an image, `cutout` when its alpha cuts holes; one `release` belongs to each. */
  acquire(hash: string, cutout: boolean): Promise<Texture> {
    const name = `${hash} ${cutout}`;
    const found = this.entries.get(name) ?? { texture: this.load(hash, cutout), uses: 0 };
    found.uses++;
    this.entries.set(name, found);
    return found.texture;
  }

  release(hash: string, cutout: boolean): void {
    const found = this.entries.get(`${hash} ${cutout}`);
    if (!found || --found.uses > 0) return;
    this.entries.delete(`${hash} ${cutout}`);
    found.texture.then(free, () => undefined);
  }

  private async load(hash: string, cutout: boolean): Promise<Texture> {
    // Without the signal of the first who asks: others may be waiting for the same image.
    const { signal } = new AbortController();
    const key = textureKey(hash);
    const bytes = await this.servers.of(key).get(key, signal);
    const texture = cutout ? await this.cutoutOf(bytes, hash, signal) : await opaqueOf(bytes, hash);
    texture.colorSpace = SRGBColorSpace;
    texture.flipY = false;
    texture.wrapS = texture.wrapT = RepeatWrapping;
    texture.magFilter = LinearFilter;
    texture.minFilter = LinearMipmapLinearFilter;
    texture.anisotropy = this.anisotropy();
    texture.needsUpdate = true;
    return texture;
  }

  /** The card would mix into the smaller sizes whatever colour lies in the holes, so they are made by hand. */
  private async cutoutOf(bytes: Uint8Array, hash: string, signal: AbortSignal): Promise<Texture> {
    const levels = await this.pool.decode("cutout", bytes, textureKey(hash), signal);
    const sizes = levels.map(({ pixels, width, height }) => ({ data: new Uint8Array(pixels.buffer), width, height }));
    const texture = new DataTexture(sizes[0]!.data, sizes[0]!.width, sizes[0]!.height);
    texture.mipmaps = sizes as never;
    texture.generateMipmaps = false;
    return texture;
  }
}

async function opaqueOf(bytes: Uint8Array, hash: string): Promise<Texture> {
  try {
    const options = { premultiplyAlpha: "none", colorSpaceConversion: "none" } as const;
    return new Texture(await createImageBitmap(new Blob([bytes as BlobPart]), options));
  } catch {
    throw new FarfieldError("corrupt", "the image cannot be decoded", textureKey(hash));
  }
}

/** Bytes a texture takes with its mip levels. */
export function textureBytes(texture: Texture): number {
  const { width, height } = texture.image as { width: number; height: number };
  return Math.round((width * height * 4 * 4) / 3);
}

function free(texture: Texture): void {
  (texture.image as Partial<ImageBitmap>).close?.();
  texture.dispose();
}
