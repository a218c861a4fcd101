import type { Backoff } from "../core/backoff.js";
import { asFarfieldError, FarfieldError } from "../core/errors.js";
import type { Fetcher } from "../core/fetch.js";
import { WorldIndex, type WorldEvents } from "../core/world.js";

/** Address of a world's folder, with a slash at its end, from that of the folder or of its world.json. */
export function folderOf(url: string | URL): string {
  const address = new URL(url, globalThis.location?.href);
  address.search = address.hash = "";
  address.pathname = address.pathname.replace(/world\.json$/, "").replace(/\/?$/, "/");
  return address.href;
}

/**
 * Reads a world's manifest, again and again while the server does not answer. Rejects with what cannot be mended by
 * waiting: `not-a-world`, `version` or, when nobody wants it any more, `aborted`.
 */
export async function openIndex(
  fetcher: Fetcher,
  backoff: Backoff,
  events: WorldEvents,
  signal: AbortSignal,
): Promise<WorldIndex> {
  for (;;) {
    try {
      const index = await WorldIndex.open(fetcher, backoff, events, signal);
      backoff.succeeded();
      return index;
    } catch (thrown) {
      const error = asFarfieldError(thrown, fetcher.base);
      if (error.tag === "missing") {
        throw new FarfieldError("not-a-world", "no world here", fetcher.base, "is this the address of a baked world?");
      }
      if (error.tag !== "network") throw error;
      backoff.failed(error.what);
      await backoff.rest();
    }
  }
}
