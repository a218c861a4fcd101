import { describe, expect, it } from "vitest";
import { cut, type CutCell } from "../src/core/cut.js";
import { viewBin } from "../src/core/directions.js";
import { formatKey, Grid, type CellKey } from "../src/core/grid.js";
import { middleOf, type Box, type Vector3 } from "../src/core/vector.js";
import { listVectors, readJson } from "./vectors.js";

/** What scripts/write_cut_vectors.py writes. */
interface CutVectors {
  readonly grid: { leaf_size: number; resolution: number; corner: Vector3; axis_levels: Vector3 };
  readonly leaves: readonly Vector3[];
  readonly cases: readonly {
    readonly eye: Vector3;
    readonly radius: number;
    readonly near: number;
    readonly pictures: readonly string[];
    readonly geometry: readonly string[];
    readonly bins: readonly number[];
  }[];
}

class Node implements CutCell<Node> {
  readonly children: Node[] = [];
  readonly level: number;
  readonly box: Box;

  constructor(
    readonly key: CellKey,
    grid: Grid,
  ) {
    this.level = key.level;
    this.box = grid.bounds(key);
  }
}

/** The roots of the tree over some leaves. */
function growTree(grid: Grid, leaves: readonly Vector3[]): Node[] {
  const known = new Map<string, Node>();
  const roots: Node[] = [];
  const get = (key: CellKey): Node => {
    const found = known.get(formatKey(key));
    if (found) return found;
    const node = new Node(key, grid);
    known.set(formatKey(key), node);
    if (key.level === grid.topLevel) roots.push(node);
    else get(grid.ancestor(key, key.level + 1)).children.push(node);
    return node;
  };
  for (const [x, y, z] of leaves) get({ level: 0, x, y, z });
  const ascending = (a: Node, b: Node): number => a.key.x - b.key.x || a.key.y - b.key.y || a.key.z - b.key.z;
  for (const node of known.values()) node.children.sort(ascending);
  return roots.sort(ascending);
}

const names = (nodes: readonly Node[]): string[] => nodes.map(({ key }) => formatKey(key));

describe("the cut and the view bins are those of Python", () => {
  it.each(listVectors("cut", ".json"))("%s", (file) => {
    const { grid: g, leaves, cases } = readJson<CutVectors>(`cut/${file}`);
    const grid = new Grid(g.leaf_size, g.resolution, g.corner, g.axis_levels);
    const roots = growTree(grid, leaves);
    expect(cases.length).toBeGreaterThan(10);
    for (const { eye, radius, near, pictures, geometry, bins } of cases) {
      const found = cut(roots, eye, radius, near);
      expect(names(found.pictures)).toEqual(pictures);
      expect(names(found.geometry)).toEqual(geometry);
      expect(found.unknown).toEqual([]);
      const chosen = [...found.pictures, ...found.geometry];
      expect(chosen.map(({ box }) => viewBin(middleOf(box), eye))).toEqual(bins);
    }
  });

  it("takes a cell for a picture while the index below it is unknown", () => {
    const cell = { level: 3, box: { lower: [0, 0, 0], upper: [8, 8, 8] } as Box, children: null };
    expect(cut([cell], [4, 4, 4], 1, 1)).toEqual({ pictures: [cell], geometry: [], unknown: [cell] });
  });
});
