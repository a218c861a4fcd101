import { corrupt } from "../errors.js";
import { OBJECT_IDS, readTile, type TileHeader } from "./header.js";
import { depthPlane, objectPlane } from "./planes.js";
import { restoreDepth, unzigzag } from "./predict.js";

/** Which object each pixel of an orthoview tile shows, and where it lies. */
export interface ObjectTile {
  /** Lattice column and row of the first pixel. */
  readonly x: number;
  readonly y: number;
  /** Depth steps of code 0. */
  readonly depthBase: number;
  readonly level: number;
  readonly direction: number;
  /** (valid,) column | row << 12, ascending. */
  readonly position: Uint32Array;
  /** (valid,) depth codes. */
  readonly depths: Uint16Array;
  /** (valid,) object ids, 0 = none. */
  readonly ids: Uint32Array;
}

/**
 * Reads the object ids of an orthoview tile, of which depth alone is read: only it says which pixels there are. Throws `corrupt` for
 * anything but both whole. Allocates at most 32 bytes a pixel of the rectangle, 1 MB for tables, and what `inflate` takes.
 */
export function decodeObjectTile(tile: Uint8Array, objects: Uint8Array, where: string): ObjectTile {
  const header = readTile(tile, where);
  const own = readTile(objects, where, OBJECT_IDS);
  if (!isSamePlace(header, own)) throw corrupt("the object ids belong to another tile", where);
  const { pixels, zigzags } = depthPlane(header, where);
  const depths = unzigzag(zigzags);
  restoreDepth(depths, pixels);
  const { x, y, depthBase, level, direction } = header;
  return { x, y, depthBase, level, direction, position: pixels.position, depths, ids: objectPlane(own, pixels, where) };
}

function isSamePlace(a: TileHeader, b: TileHeader): boolean {
  const numbersOf = ({ x, y, width, height, valid }: TileHeader): number[] => [x, y, width, height, valid];
  const others = numbersOf(b);
  return numbersOf(a).every((number, n) => number === others[n]);
}

/** Pixels: a footprint reaches 0.7 of one beyond its middle, and is drawn up to one farther from the eye than it lies (spec/drawing.md, Splats). */
const NEAR = 2;

/** The pixel in or beside a place that shows it best. */
export interface ObjectMatch {
  readonly id: number;
  /** How far the pixel is from the place, pitches; a pitch along the view counts half, as surfaces may be steep. */
  readonly away: number;
}

/**
 * What a tile shows at a place: (column, row, depth) in pitches from its first column and row and from depth code 0. Of the pixel there and those
 * up to NEAR beside it, whose footprints may be seen there, the nearest; null: there is none.
 */
export function objectAt({ position, depths, ids }: ObjectTile, [column, row, depth]: readonly [number, number, number]): ObjectMatch | null {
  let best: ObjectMatch | null = null;
  for (let j = Math.floor(row) - NEAR; j <= Math.floor(row) + NEAR; j++) {
    for (let i = Math.floor(column) - NEAR; i <= Math.floor(column) + NEAR; i++) {
      const k = placeOf(position, i, j);
      if (k < 0) continue;
      const away = Math.hypot(column - i - 0.5, row - j - 0.5, (depth - depths[k]! / 8) / 2);
      if (!best || away < best.away) best = { id: ids[k]!, away };
    }
  }
  return best;
}

/** Where a pixel stands in valid order; -1: it shows nothing. */
function placeOf(position: Uint32Array, column: number, row: number): number {
  if (column < 0 || row < 0 || column > 4095 || row > 4095) return -1;
  const wanted = column | (row << 12);
  let [from, to] = [0, position.length];
  while (from < to) {
    const middle = (from + to) >> 1;
    if (position[middle]! < wanted) from = middle + 1;
    else to = middle;
  }
  return position[from] === wanted ? from : -1;
}
