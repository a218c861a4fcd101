import type { WorldStats } from "../three/stats.js";

const WINDOW_MS = 2000;

/** Bytes a second over the last two seconds. */
export class Rate {
  private readonly samples: { readonly time: number; readonly bytes: number }[] = [];

  at(time: number, bytes: number): number {
    this.samples.push({ time, bytes });
    while (this.samples.length > 2 && time - this.samples[0]!.time > WINDOW_MS) this.samples.shift();
    const first = this.samples[0]!;
    return time > first.time ? ((bytes - first.bytes) * 1000) / (time - first.time) : 0;
  }
}

/** The figures of the panel as people read them. */
export function figuresOf(stats: WorldStats, frameMs: number, rate: number): Record<string, string> {
  const levels = Object.entries(stats.cells).sort(([a], [b]) => Number(a) - Number(b));
  return {
    Frame: `${frameMs.toFixed(frameMs < 20 ? 1 : 0)} ms`,
    "Splats held": count(stats.splats_in_memory),
    "in the frustum": count(stats.splats_in_frustum),
    drawn: count(stats.splats_drawn),
    Triangles: count(stats.triangles + stats.moving_triangles),
    "Cells by level": levels.map(([level, n]) => `${level}: ${n}`).join("  ") || "–",
    "Cells by kind": kindsOf(stats),
    Received: size(stats.bytes),
    "by a session": stats.session || stats.pushed_bytes > 0 ? `${size(stats.pushed_bytes)}${stats.session ? "" : ", ended"}` : "–",
    "Now receiving": `${size(rate)}/s`,
    "Cache used": `${size(stats.cache_bytes)} of ${size(stats.cache_budget)}`,
    Loading: stats.tiles_pending > 0 ? `${stats.tiles_pending} tiles` : "–",
    Missing: count(stats.tiles_missing),
  };
}

function kindsOf({ kinds: { orthoview, blockmap, geometry } }: WorldStats): string {
  const named = { pictures: orthoview, BlockMaps: blockmap, geometry };
  const there = Object.entries(named).filter(([, cells]) => cells > 0);
  return there.map(([kind, cells]) => `${kind}: ${count(cells)}`).join("  ") || "–";
}

export function count(value: number): string {
  if (value < 10_000) return String(Math.round(value));
  return value < 1e6 ? `${(value / 1e3).toFixed(0)} k` : `${(value / 1e6).toFixed(1)} M`;
}

export function size(bytes: number): string {
  if (bytes < 1e3) return `${Math.round(bytes)} B`;
  if (bytes < 1e6) return `${(bytes / 1e3).toFixed(0)} kB`;
  if (bytes < 1e8) return `${(bytes / 1e6).toFixed(1)} MB`;
  return bytes < 1e9 ? `${Math.round(bytes / 1e6)} MB` : `${(bytes / 1e9).toFixed(2)} GB`;
}
