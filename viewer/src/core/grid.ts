import { FarfieldError } from "./errors.js";
import { MAXIMUM_LEVEL } from "./limits.js";
import type { Box, Vector3 } from "./vector.js";

/** Name of a cell: level counted up from the leaves, signed indices along x, y, z. */
export interface CellKey {
  readonly level: number;
  readonly x: number;
  readonly y: number;
  readonly z: number;
}

const KEY = /^(0|[1-9][0-9]?)\/(0|-?[1-9][0-9]{0,12})\/(0|-?[1-9][0-9]{0,12})\/(0|-?[1-9][0-9]{0,12})$/;

/** From `level/x/y/z`, as `formatKey` writes it. Throws `corrupt` when it is none, or too far up or out. */
export function parseKey(text: string): CellKey {
  const [level, x, y, z] = (KEY.exec(text)?.slice(1) ?? []).map(Number) as [number?, number?, number?, number?];
  const near = (index: number | undefined): index is number => index !== undefined && Math.abs(index) <= 2 ** MAXIMUM_LEVEL;
  if (level === undefined || level > MAXIMUM_LEVEL || !near(x) || !near(y) || !near(z)) {
    throw new FarfieldError("corrupt", "not a cell key", text.slice(0, 80));
  }
  return { level, x, y, z };
}

export function formatKey({ level, x, y, z }: CellKey): string {
  return `${level}/${x}/${y}/${z}`;
}

/** Where cells lie (spec/world.md, Manifest). */
export class Grid {
  constructor(
    /** Edge of a leaf, metres. */
    readonly leafSize: number,
    /** Pixels of an orthoview across one leaf edge. */
    readonly resolution: number,
    /** Local metres of the lower corner of cell 0/0/0/0: zero of every pixel lattice. */
    readonly corner: Vector3,
    /** Level from which cells no longer merge along x, y, z. */
    readonly axisLevels: Vector3,
  ) {}

  /** Level of the roots. */
  get topLevel(): number {
    return Math.max(...this.axisLevels);
  }

  /** Metres between pixels of an orthoview at that level; also its geometric error. */
  pitch(level: number): number {
    return (this.leafSize / this.resolution) * 2 ** level;
  }

  /** Edges of a cell of that level, metres. */
  cellSize(level: number): Vector3 {
    const [x, y, z] = this.axisLevels;
    return [
      this.leafSize * 2 ** Math.min(level, x),
      this.leafSize * 2 ** Math.min(level, y),
      this.leafSize * 2 ** Math.min(level, z),
    ];
  }

  /** Half-open box of a cell, local metres. */
  bounds({ level, x, y, z }: CellKey): Box {
    const size = this.cellSize(level);
    const [cx, cy, cz] = this.corner;
    const lower: Vector3 = [cx + x * size[0], cy + y * size[1], cz + z * size[2]];
    return { lower, upper: [lower[0] + size[0], lower[1] + size[1], lower[2] + size[2]] };
  }

  /** Whether a cell lies below another, one level down. */
  isChild(child: CellKey, parent: CellKey): boolean {
    if (child.level !== parent.level - 1) return false;
    const { x, y, z } = this.ancestor(child, parent.level);
    return x === parent.x && y === parent.y && z === parent.z;
  }

  /** The cell of that level (at least the key's own) that holds this one. */
  ancestor(key: CellKey, level: number): CellKey {
    const along = (index: number, axis: 0 | 1 | 2): number => {
      const last = this.axisLevels[axis];
      const shift = Math.min(level, last) - Math.min(key.level, last);
      return Math.floor(index / 2 ** shift);
    };
    return { level, x: along(key.x, 0), y: along(key.y, 1), z: along(key.z, 2) };
  }

  /** Which child of its parent a cell is: bit 0 upper along x, 1 along y, 2 along z; unmerged axes give 0. */
  octant(key: CellKey): number {
    const bit = (index: number, axis: 0 | 1 | 2): number =>
      key.level < this.axisLevels[axis] ? (index & 1) << axis : 0;
    return bit(key.x, 0) | bit(key.y, 1) | bit(key.z, 2);
  }
}
