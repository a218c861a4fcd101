import { DataTexture, LinearFilter, LinearMipmapLinearFilter, RepeatWrapping, SRGBColorSpace, Texture, type Wrapping } from "three";
import type { DecodePool } from "../../core/decode/pool.js";
import { FarfieldError } from "../../core/errors.js";
import { hashOfTexture, textureKey } from "../../core/keys.js";
import type { Resource } from "../../core/resource.js";
import type { Servers } from "../../core/servers.js";

interface Entry {
  readonly texture: Promise<Texture>;
  uses: number;
}

/** Bytes of images that have come before what refers to them. */
const MOST_AHEAD = 16 << 20;

/** Images that several GLBs refer to, fetched once each, or put here before, and freed with their last user. */
export class TextureShelf {
  private readonly entries = new Map<string, Entry>();
  /** As they came, oldest first. */
  private readonly ahead = new Map<string, Uint8Array>();
  /** Asked for before what refers to them has come. */
  private readonly expected = new Map<string, Promise<Uint8Array>>();

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

  /** Whether someone has its texture already, and pays for its room on the card. */
  isTaken(hash: string, cutout: boolean): boolean {
    return this.entries.has(`${hash} ${cutout}`);
  }

  /** Whether an image is there, or on its way. */
  holds(hash: string): boolean {
    return this.ahead.has(hash) || this.expected.has(hash) || this.entries.has(`${hash} false`) || this.entries.has(`${hash} true`);
  }

  /** Asks for an image that will be asked for: geometry has to be there, and be decoded, before it does itself. */
  expect(hash: string): void {
    if (this.holds(hash)) return;
    const key = textureKey(hash);
    const value = this.servers.of(key).get(key, new AbortController().signal);
    this.expected.set(hash, value);
    // Who needs it asks once more, and tells what is wrong.
    value.then((bytes) => this.put(key, bytes), () => undefined).finally(() => this.expected.delete(hash));
  }

  /** Takes an image that will be asked for. */
  put(key: string, value: Uint8Array): void {
    this.ahead.set(hashOfTexture(key), value.slice());
    let bytes = 0;
    for (const { length } of this.ahead.values()) bytes += length;
    for (const [hash, { length }] of this.ahead) {
      if (bytes <= MOST_AHEAD) return;
      this.ahead.delete(hash);
      bytes -= length;
    }
  }

  /** Of all images that are there, or on their way. */
  keys(): string[] {
    const hashes = [...this.ahead.keys(), ...[...this.entries.keys()].map((name) => name.split(" ")[0]!)];
    return [...new Set(hashes)].map(textureKey);
  }

  /** Images that have come and are drawn by themselves, as is found by now; they are kept no longer. */
  taken(find: (key: string) => Resource | null): [Resource, Uint8Array][] {
    return [...this.ahead].flatMap(([hash, value]) => {
      const resource = find(textureKey(hash));
      if (resource) this.ahead.delete(hash);
      return resource ? [[resource, value] as [Resource, Uint8Array]] : [];
    });
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
    await this.expected.get(hash)?.catch(() => undefined);
    const ahead = this.ahead.get(hash);
    this.ahead.delete(hash);
    const bytes = ahead ?? (await this.servers.of(key).get(key, signal));
    const texture = cutout ? await cutoutOf(this.pool, bytes, key, signal) : await opaqueOf(bytes, hash);
    return sampled(texture, RepeatWrapping, this.anisotropy());
  }
}

/** The card would mix into the smaller sizes whatever colour lies in the holes, so they are made by hand. */
export async function cutoutOf(pool: DecodePool, bytes: Uint8Array, key: string, signal: AbortSignal): Promise<Texture> {
  const levels = await pool.decode("cutout", bytes, key, signal);
  const sizes = levels.map(({ pixels, width, height }) => ({ data: new Uint8Array(pixels.buffer), width, height }));
  const texture = new DataTexture(sizes[0]!.data, sizes[0]!.width, sizes[0]!.height);
  texture.mipmaps = sizes as never;
  texture.generateMipmaps = false;
  return texture;
}

/** A texture as surfaces of near geometry show it; row 0 is v = 0. */
export function sampled(texture: Texture, wrapping: Wrapping, anisotropy: number): Texture {
  texture.colorSpace = SRGBColorSpace;
  texture.flipY = false;
  texture.wrapS = texture.wrapT = wrapping;
  texture.magFilter = LinearFilter;
  texture.minFilter = LinearMipmapLinearFilter;
  texture.anisotropy = anisotropy;
  texture.needsUpdate = true;
  return texture;
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
