import type { Backoff } from "../core/backoff.js";
import { asFarfieldError, FarfieldError } from "../core/errors.js";
import { ArchiveFetcher } from "../core/archive/fetcher.js";
import { Fetcher } from "../core/fetch.js";
import { decodeManifest, type Manifest } from "../core/manifest.js";
import type { Source } from "../core/source.js";

/** How the name of an archive ends. */
const ARCHIVE = /\.farfield$/;

/** What reads the world at the address of an archive, of its folder or of its world.json. */
export function sourceOf(url: string | URL): Source {
  const address = new URL(url, globalThis.location?.href);
  address.hash = "";
  return ARCHIVE.test(address.pathname) ? new ArchiveFetcher(address.href) : new Fetcher(folderOf(address));
}

/** Address of a world's folder, with a slash at its end, from that of the folder or of its world.json. */
function folderOf(url: URL): string {
  const address = new URL(url);
  address.search = address.hash = "";
  address.pathname = address.pathname.replace(/world\.json$/, "").replace(/\/?$/, "/");
  return address.href;
}

/**
 * Reads a world's manifest, again and again while the server does not answer. Rejects with what cannot be mended by
 * waiting: `not-a-world`, `version`, `no-ranges`, `corrupt` or, when nobody wants it any more, `aborted`.
 */
export async function openManifest(source: Source, backoff: Backoff, signal: AbortSignal): Promise<Manifest> {
  for (;;) {
    try {
      const text = await source.manifest(signal);
      backoff.succeeded();
      return manifestOf(text, source);
    } catch (thrown) {
      const error = asFarfieldError(thrown, source.base);
      if (error.tag === "missing") {
        throw new FarfieldError("not-a-world", "no world here", source.base, "is this the address of a baked world?");
      }
      if (error.tag !== "network") throw error;
      backoff.failed(error.what);
      await backoff.rest();
    }
  }
}

function manifestOf(text: string, source: Source): Manifest {
  const manifest = decodeManifest(text, `${source.base}world.json`);
  if (manifest.servers && source instanceof ArchiveFetcher) {
    throw new FarfieldError("not-a-world", "an archive holds all of a world and is not split over servers", source.base);
  }
  return manifest;
}
