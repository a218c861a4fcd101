import { describe, expect, it } from "vitest";
import { Cell, SharedMeshes } from "../src/core/cell.js";
import { formatKey, Grid, parseKey } from "../src/core/grid.js";
import type { CellEntry } from "../src/core/indextile.js";
import type { Resource } from "../src/core/resource.js";
import type { Viewing } from "../src/core/stream/motion.js";
import { Pictures, type CellsView, type Part } from "../src/core/stream/pictures.js";
import { Scheduler } from "../src/core/stream/scheduler.js";
import type { Vector3 } from "../src/core/vector.js";
import { listVectors, readJson } from "./vectors.js";

/** What scripts/write_stream_vectors.py writes. */
interface StreamVectors {
  readonly grid: { leaf_size: number; resolution: number; corner: Vector3; axis_levels: Vector3 };
  readonly fov: number;
  readonly size: [number, number];
  readonly roots: readonly string[];
  readonly entries: readonly CellEntry[];
  readonly cases: readonly {
    readonly movement: string;
    readonly viewings: readonly Omit<Viewing, "focal" | "size">[];
    readonly now: number;
    readonly far: number;
    readonly near: number | null;
    readonly bandwidth: number;
    readonly latency: number;
    readonly held: readonly string[];
    readonly chosen: readonly { cell: string; geometry: boolean; keys: string[]; bytes: number; benefit: number }[];
  }[];
}

/** The cells of a world, and all their resources by key. */
function readWorld({ grid: g, roots, entries }: StreamVectors): { roots: Cell[]; resources: Map<string, Resource> } {
  const grid = new Grid(g.leaf_size, g.resolution, g.corner, g.axis_levels);
  const byKey = new Map(entries.map((entry) => [entry.key, entry]));
  const shared = new SharedMeshes();
  const cells = roots.map((key) => {
    const cell = new Cell(parseKey(key), null, grid);
    cell.read(byKey, shared, "test");
    return cell;
  });
  const resources = new Map<string, Resource>();
  const list = (cell: Cell): void => {
    const own = [...cell.views.values()].flatMap(({ layers }) => layers);
    const near = cell.forms.flatMap(({ leaf, meshes }) => [leaf, ...meshes]);
    const placed = cell.instances.flatMap(({ forms, impostors }) => [...forms, ...impostors.flatMap(({ boards }) => boards)].map(({ mesh }) => mesh));
    for (const resource of [...own, ...near, ...placed]) resources.set(resource.key, resource);
    cell.children?.forEach(list);
  };
  cells.forEach(list);
  return { roots: cells, resources };
}

describe("what is to be sent is what Python says", () => {
  it.each(listVectors("stream", ".json"))("%s", (file) => {
    const vectors = readJson<StreamVectors>(`stream/${file}`);
    const focal = vectors.size[1] / 2 / Math.tan((vectors.fov / 2 / 180) * Math.PI);
    const pitch = vectors.grid.leaf_size / vectors.grid.resolution;
    expect(vectors.cases.length).toBeGreaterThan(10);
    for (const { viewings, now, far, near, bandwidth, latency, held, chosen } of vectors.cases) {
      const { roots, resources } = readWorld(vectors);
      // Images of geometry, of which the viewer knows no more than their names.
      const isImage = (key: string): boolean => key.startsWith("texture/") && !resources.has(key);
      const images = new Set(held.filter(isImage));
      for (const key of held) if (!isImage(key)) resources.get(key)!.state = "held";
      const view: CellsView = {
        roots, directions: new Map(), grid: { leafSize: vectors.grid.leaf_size, resolution: vectors.grid.resolution }, farGeometry: true, radius: focal * pitch, near: near ?? focal * pitch, farOnly: false,
        choice: { views: null, leastGain: 10, layers: 2 }, holdsImage: (hash) => images.has(`texture/${hash}`), lacks: () => false,
      };
      const scheduler = new Scheduler<Part>(new Pictures(() => view), () => far, () => ({ bandwidth, latency }));
      for (const viewing of viewings) scheduler.follow({ ...viewing, focal, size: vectors.size }, viewing.time);
      const found = scheduler.order(now, chosen.length + 1);
      const seen = new Set<string>();
      const fresh = (keys: string[]): string[] => keys.filter((key) => !seen.has(key) && seen.add(key));
      expect(found.slice(0, chosen.length).map(({ offer: { item }, size }) => ({
        cell: item.mesh ?? formatKey(item.cell.key), geometry: item.isGeometry, keys: fresh(item.resources.map(({ key }) => key)), bytes: size,
      }))).toEqual(chosen.map(({ cell, geometry, keys, bytes }) => ({ cell, geometry, keys: keys.filter((key) => !isImage(key)), bytes })));
      if (chosen.length < 24) expect(found).toHaveLength(chosen.length);
      found.slice(0, chosen.length).forEach(({ benefit }, n) => {
        expect(Math.abs(benefit / chosen[n]!.benefit - 1)).toBeLessThan(1e-4);
      });
    }
  });
});
