import type { Plan } from "../core/plan.js";
import type { ResourceKind } from "../core/resource.js";
import type { Source } from "../core/source.js";
import type { WorldOptions } from "./options.js";
import type { Session } from "./session.js";

/** Figures of a world, for people and tests. */
export interface WorldStats {
  /** Generation of the world that is shown; 0 before its manifest has been read. */
  readonly generation: number;
  /** Splats drawn last, before the graphics card skips those that face away. */
  readonly splats: number;
  /** Of all tiles that are held, of the parts of those drawn that lie in the frustum, and drawn. */
  readonly splats_in_memory: number;
  readonly splats_in_frustum: number;
  readonly splats_drawn: number;
  /** Runs of pixels drawn last: a tile is one draw call of them. */
  readonly splat_runs: number;
  /** Triangles of near geometry drawn last. */
  readonly triangles: number;
  /** BlockMaps drawn last, and draw calls for them. */
  readonly blockmaps: number;
  readonly blockmap_calls: number;
  /** Orthoview tiles drawn last: as many draw calls. */
  readonly tiles: number;
  /** Cells drawn from pictures, by level. */
  readonly cells: Readonly<Record<number, number>>;
  /** Cells by what they are drawn from, in the picture or not: of kinds that buy more for their bytes than others. */
  readonly kinds: Readonly<Record<"orthoview" | "blockmap" | "geometry", number>>;
  /** Cells drawn as geometry: leaves, and cells above by geometry of their own. */
  readonly geometry_cells: number;
  /** Cells drawn in place of others that are not there. */
  readonly stand_ins: number;
  /** Cells of the whole cut, in the picture or not. */
  readonly cut_cells: number;
  /** Bytes and requests since the world was opened; the bytes of them that a server sent by its own decision, and whether it does. */
  readonly bytes: number;
  readonly pushed_bytes: number;
  readonly session: boolean;
  readonly requests: number;
  /** Values the picture wants that have not arrived. */
  readonly tiles_pending: number;
  /** Values found missing or damaged so far. */
  readonly tiles_missing: number;
  readonly cache_bytes: number;
  readonly cache_budget: number;
  /** How many levels coarser the cut is than asked, because the budget would not hold it. */
  readonly coarsened: number;
  /** Cells of the cut within the picture in whose place nothing is drawn, neither finer nor coarser. */
  readonly cells_empty: number;
  /** Share of the picture in which something coarser stands in, and by how many levels on average there. */
  readonly stand_in_share: number;
  readonly stand_in_levels: number;
  /** Bytes fetched ahead and not decoded yet, and how many there may be. */
  readonly ahead_bytes: number;
  readonly ahead_budget: number;
  /** Part of `cache_bytes` that is on the graphics card. */
  readonly uploaded_bytes: number;
  /** Values and index tiles asked for, needed now or not, that have not come. */
  readonly under_way: number;
  /** How much less is drawn than asked, because the camera moves and frames take too long: 0 to 5. */
  readonly reduction: number;
  /** Objects that may move, and triangles of those that are visible. */
  readonly moving_objects: number;
  readonly moving_triangles: number;
}

/** Figures that the world knows and its session does not. */
type OwnFigures = "reduction" | "moving_objects" | "moving_triangles";

export function statsOf(session: Session | null, source: Source, options: WorldOptions, bad: number): Omit<WorldStats, OwnFigures> {
  const { plan = null, loader, splats, near, blockmaps, preparer } = session ?? {};
  const { bytes, requests } = session?.traffic ?? source;
  const cells: Record<number, number> = {};
  for (const { cell } of plan?.pictures ?? []) cells[cell.level] = (cells[cell.level] ?? 0) + 1;
  const kinds = kindsOf(plan);
  return {
    generation: session?.index.manifest.generation ?? 0,
    splats: splats?.culler?.drawn ?? 0,
    splats_in_memory: preparer?.splats ?? 0,
    splats_in_frustum: splats?.culler?.inFrustum ?? 0,
    splats_drawn: splats?.culler?.drawn ?? 0,
    splat_runs: splats?.culler?.ranges.total ?? 0,
    triangles: near?.triangles ?? 0,
    blockmaps: blockmaps?.stats.maps ?? 0,
    blockmap_calls: blockmaps?.stats.calls ?? 0,
    tiles: splats?.tiles ?? 0,
    cells,
    kinds,
    geometry_cells: kinds.geometry,
    stand_ins: plan?.standIns ?? 0,
    cut_cells: plan ? plan.cut.pictures.length + plan.cut.geometry.length : 0,
    bytes,
    pushed_bytes: session?.push?.bytes ?? 0,
    session: session?.push?.on ?? false,
    requests,
    tiles_pending: session?.pending ?? 0,
    tiles_missing: bad,
    cache_bytes: loader?.cache.bytes ?? 0,
    cache_budget: options.cacheBytes,
    coarsened: session?.coarsened ?? 0,
    cells_empty: session?.shown?.empty ?? 0,
    stand_in_share: session?.shown?.standInShare ?? 0,
    stand_in_levels: session?.shown?.standInLevels ?? 0,
    ahead_bytes: loader?.stock.bytes ?? 0,
    ahead_budget: loader?.stock.budget ?? 0,
    uploaded_bytes: loader?.uploaded ?? 0,
    under_way: session?.underWay ?? 0,
  };
}

function kindsOf(plan: Plan | null): WorldStats["kinds"] {
  const { pictures = [], geometry = [], solids = [] } = plan ?? {};
  const drawn = [...pictures.map(({ tiles }) => tiles[0]!), ...solids.map(({ form }) => form.leaf)];
  const of = (wanted: ResourceKind) => drawn.filter(({ kind }) => kind === wanted).length;
  return { orthoview: of("orthoview"), blockmap: of("blockmap"), geometry: geometry.length + of("geometry") };
}
