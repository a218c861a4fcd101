import { Cell, SharedMeshes } from "../src/core/cell.js";
import { axesOf, PRINCIPAL } from "../src/core/directions.js";
import type { Frustum } from "../src/core/frustum.js";
import { formatKey, Grid, type CellKey } from "../src/core/grid.js";
import type { CellEntry } from "../src/core/indextile.js";
import type { Direction, Manifest } from "../src/core/manifest.js";
import type { PlanView } from "../src/core/plan.js";
import type { Resource } from "../src/core/resource.js";
import type { Vector3 } from "../src/core/vector.js";

/** Sees everything. */
export const EVERYWHERE: Frustum = [];

/** A flat world of 4 x 4 leaves, 1 m each, three levels; every cell has views 4, 14 and 22 in one layer of 1000 bytes. */
export const GRID = new Grid(1, 16, [0, 0, 0], [2, 2, 0]);
export const VIEWS = [4, 14, 22];

export const DIRECTIONS: ReadonlyMap<number, Direction> = new Map(
  VIEWS.map((number) => {
    const [x, y, z] = PRINCIPAL[number]!;
    const length = Math.hypot(x, y, z);
    const vector: Vector3 = [x / length, y / length, z / length];
    return [number, { number, vector, axes: axesOf(vector) }];
  }),
);

export const MANIFEST: Manifest = {
  text: "", generation: 1, name: "test", crs: null, origin: [0, 0, 0],
  bounds: { lower: [0, 0, 0], upper: [4, 4, 1] },
  grid: GRID, directions: DIRECTIONS, depthLayers: 1, indexDepth: 4,
    near: 1, roots: [], credits: [], view: null, attributes: null, servers: null,
};

function entryOf(key: CellKey): CellEntry {
  const { lower, upper } = GRID.bounds(key);
  const children: string[] = [];
  for (const x of [0, 1]) {
    for (const y of [0, 1]) {
      if (key.level > 0) children.push(formatKey({ level: key.level - 1, x: key.x * 2 + x, y: key.y * 2 + y, z: 0 }));
    }
  }
  return {
    key: formatKey(key), bounds: [lower, upper], error: GRID.pitch(key.level), hash: "00",
    tiles: VIEWS.map((direction) => [direction, 0, 1000] as const),
    views: new Array(26).fill(VIEWS), children,
    ...(key.level === 0 ? { geometry: { hash: "11", bytes: 500, triangles: 2, instances: 0, meshes: [] } } : {}),
  };
}

/** The root of that world, with nothing held, and its cells by name; changes: of all entries, or of each. */
export function makeWorld(changes: Partial<CellEntry> | ((key: CellKey) => Partial<CellEntry>) = {}): { root: Cell; cells: Map<string, Cell> } {
  const changesOf = typeof changes === "function" ? changes : () => changes;
  const entries = new Map<string, CellEntry>();
  for (let level = 0; level <= 2; level++) {
    for (let x = 0; x < 4 >> level; x++) {
      for (let y = 0; y < 4 >> level; y++) {
        const entry = entryOf({ level, x, y, z: 0 });
        entries.set(entry.key, { ...entry, ...changesOf({ level, x, y, z: 0 }) });
      }
    }
  }
  const root = new Cell({ level: 2, x: 0, y: 0, z: 0 }, null, GRID);
  root.read(entries, new SharedMeshes(), "test");
  const cells = new Map<string, Cell>();
  const list = (cell: Cell): void => {
    cells.set(cell.name, cell);
    cell.children?.forEach(list);
  };
  list(root);
  return { root, cells };
}

/** Marks resources as held, as the loader does. */
export function hold(resources: Iterable<Resource>): void {
  for (const resource of resources) {
    resource.state = "held";
    for (let cell = resource.cell; cell; cell = cell.parent) cell.heldBelow++;
  }
}

export function tilesOf(cell: Cell): Resource[] {
  return [...cell.views.values()].flatMap(({ layers }) => layers);
}

/** Everything from leaves: an eye that wants all of them. */
export function view(changes: Partial<PlanView> = {}): PlanView {
  return {
    eye: [2, 2, 0.5], frustum: EVERYWHERE, radius: 100, near: 0, farOnly: false, focal: 100, grid: GRID, farGeometry: false,
    choice: { views: 2, leastGain: 10, layers: 2 }, ...changes,
  };
}
