/**
 * What can go wrong, divided by what the caller can do about it.
 *
 *     network       the server does not answer: try again later
 *     missing       the server answers that it has no such thing
 *     corrupt       the bytes are not what they should be
 *     version       written by a newer farfield: upgrade
 *     not-a-world   the address holds something else
 *     no-ranges     the server sends files only as a whole: an archive needs another
 *     unsupported   this browser cannot show it
 *     limit         more than there is room for: ask for less
 *     aborted       nobody wants it any more
 */
export type ErrorTag =
  | "network"
  | "missing"
  | "corrupt"
  | "version"
  | "not-a-world"
  | "no-ranges"
  | "unsupported"
  | "limit"
  | "aborted";

/** An error that says what, where and what to try. */
export class FarfieldError extends Error {
  override readonly name = "FarfieldError";

  constructor(
    readonly tag: ErrorTag,
    /** What went wrong, without a full stop. */
    readonly what: string,
    /** Key or address it happened to. */
    readonly where = "",
    /** What to try, or empty. */
    readonly hint = "",
  ) {
    super([where ? `${where}: ${what}` : what, hint].filter(Boolean).join(" — "));
  }
}

/** The error of damaged bytes. */
export function corrupt(what: string, where: string): FarfieldError {
  return new FarfieldError("corrupt", what, where, "farfield verify --repair");
}

/** Anything thrown as a FarfieldError; abort signals become `aborted`, the rest `network`. */
export function asFarfieldError(thrown: unknown, where: string): FarfieldError {
  if (thrown instanceof FarfieldError) return thrown;
  const { name = "", message = String(thrown) } = thrown instanceof Error ? thrown : {};
  return new FarfieldError(name === "AbortError" ? "aborted" : "network", message, where);
}
