/** Figures of a world, for people and tests. */
export interface WorldStats {
  /** Splats of the tiles drawn last, before the graphics card skips those that face away. */
  readonly splats: number;
  /** Triangles of near geometry drawn last. */
  readonly triangles: number;
  /** Orthoview tiles drawn last: as many draw calls. */
  readonly tiles: number;
  /** Cells drawn from pictures, by level. */
  readonly cells: Readonly<Record<number, number>>;
  /** Leaves drawn as geometry. */
  readonly geometry_cells: number;
  /** Cells drawn in place of others that are not there. */
  readonly stand_ins: number;
  /** Cells of the whole cut, in the picture or not. */
  readonly cut_cells: number;
  /** Bytes and requests since the world was opened. */
  readonly bytes: number;
  readonly requests: number;
  /** Values the picture wants that have not arrived. */
  readonly tiles_pending: number;
  /** Values found missing or damaged so far. */
  readonly tiles_missing: number;
  readonly cache_bytes: number;
  readonly cache_budget: number;
  /** How many levels coarser the cut is than asked, because the budget would not hold it. */
  readonly coarsened: number;
}
