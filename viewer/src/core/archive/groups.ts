import type { Span } from "./layout.js";

/** Bytes that nobody asked for, between two values, that are cheaper than a request of their own. */
const GAP_BYTES = 8 << 10;
/** Most bytes of one request for several values. */
const GROUP_BYTES = 512 << 10;

/** Spans gathered into stretches that one request each can bring; each in the order of the file. */
export function groupSpans(spans: readonly Span[]): Span[][] {
  const groups: Span[][] = [];
  let [start, end] = [0, 0];
  for (const span of [...new Set(spans)].sort((a, b) => a.offset - b.offset)) {
    const last = Math.max(end, span.offset + span.length);
    const near = span.offset - end <= GAP_BYTES && last - start <= GROUP_BYTES;
    if (groups.length > 0 && near) groups.at(-1)!.push(span);
    else {
      groups.push([span]);
      start = span.offset;
      end = start;
    }
    end = Math.max(end, span.offset + span.length);
  }
  return groups;
}
