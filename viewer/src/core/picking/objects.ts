import type { Cell } from "../cell.js";
import { decodeBlockMapObjects } from "../blockmap/objects.js";
import { FarfieldError } from "../errors.js";
import type { Grid } from "../grid.js";
import { blockMapObjectsKey, objectsKey } from "../keys.js";
import type { Manifest } from "../manifest.js";
import { decodeObjectTile, objectAt, type ObjectMatch, type ObjectTile } from "../orthoview/objects.js";
import { along } from "../projection.js";
import { Recent } from "../recent.js";
import type { Resource } from "../resource.js";
import type { Servers } from "../servers.js";
import { valueOf, type Found } from "../source.js";
import { dot, type Vector3 } from "../vector.js";
import type { Candidate } from "./candidates.js";
import { pointOf, type Ray } from "./ray.js";

/** Bytes of decoded object ids that are kept: of some ten cells. */
const KEPT = 24 << 20;
/** Pitches that a pixel may be from a point to show it, and so near that no other view is asked. */
const FARTHEST = 4;
const NEAREST = 1;
/** Views of a cell that are looked at for a point, at most, beside those it is drawn from. */
const MORE_VIEWS = 3;
/**
 * Parts of a texel by which a point is moved along the ray: a hit on a wall, on its texel's border, is then in the texel behind it. From where texels are as wide
 * as pixels, single precision puts hits a tenth as far beside.
 */
const INWARD = 256;

/** Tells which object is seen at a point of a cell, by the object ids of its pictures, which are fetched for that. */
export class CellObjects {
  private readonly tiles = new Recent<ObjectTile | null>(KEPT);
  private readonly maps = new Recent<Uint32Array | null>(KEPT);

  constructor(
    private readonly servers: Pick<Servers, "of">,
    private readonly manifest: Pick<Manifest, "grid" | "directions">,
  ) {}

  /**
   * The object that a candidate shows on a ray; 0: it shows one without an id; null: it does not show what is there. Rejects with `network`, `corrupt` or
   * `aborted`.
   */
  async at({ cell, by, drawn, distance }: Candidate, ray: Ray, signal: AbortSignal): Promise<number | null> {
    if (by === "blockmap") return this.inMap(cell, drawn[0]!, ray, distance, signal);
    const match = await this.inViews(cell, drawn, pointOf(ray, distance), ray, signal);
    const map = by === "geometry" ? mapOf(cell) : null;
    return match?.id ?? (map && this.inMap(cell, map, ray, distance, signal));
  }

  private async inMap(cell: Cell, map: Resource, ray: Ray, distance: number, signal: AbortSignal): Promise<number | null> {
    const ids = await this.idsOf(cell, map, signal);
    if (!ids) return 0;
    const n = Math.sqrt(ids.length);
    const { lower, upper } = cell.box;
    const inward = Math.min(upper[0] - lower[0], upper[1] - lower[1]) / n / INWARD;
    const idAt = (point: Vector3): number => {
      const placeOf = (a: 0 | 1): number => Math.min(n - 1, Math.max(0, Math.floor(((point[a] - lower[a]) / (upper[a] - lower[a])) * n)));
      return ids[placeOf(1) * n + placeOf(0)]!;
    };
    // Just before where a roof ends, the point has been moved out of the texel.
    return idAt(pointOf(ray, distance, inward)) || idAt(pointOf(ray, distance, -inward)) || null;
  }

  /** The best match among the first layers, which alone have ids: of what is drawn, the views that look along the ray first, and then of others. */
  private async inViews(cell: Cell, drawn: readonly Resource[], point: Vector3, { direction }: Ray, signal: AbortSignal): Promise<ObjectMatch | null> {
    const { directions } = this.manifest;
    const squarely = (view: number): number => -dot(directions.get(view)?.vector ?? [0, 0, 0], direction);
    const views = [...cell.views.values()].filter(({ direction: number, layers }) => layers[0]?.kind === "orthoview" && directions.has(number));
    views.sort((a, b) => squarely(b.direction) - squarely(a.direction));
    const own = views.filter(({ layers }) => drawn.includes(layers[0]!));
    const others = views.filter((view) => !own.includes(view)).slice(0, MORE_VIEWS);
    let best: ObjectMatch | null = null;
    for (const { direction: number, layers } of [...own, ...others]) {
      const tile = await this.tileOf(cell, number, layers[0]!, signal);
      // A world without ids has none of the other views either.
      if (!tile) return { id: 0, away: 0 };
      const match = objectAt(tile, placeIn(tile, this.manifest, number, point));
      if (match && match.away <= FARTHEST && (!best || match.away < best.away)) best = match;
      if (best && best.away <= NEAREST) break;
    }
    return best;
  }

  private async tileOf(cell: Cell, direction: number, { key }: Resource, signal: AbortSignal): Promise<ObjectTile | null> {
    const ids = objectsKey(cell.name, direction, 0, hashOf(key));
    const known = this.tiles.get(ids);
    if (known !== undefined) return known;
    const [tile, objects] = await this.fetch([key, ids], signal);
    const decoded = objects === null ? null : decodeObjectTile(valueOf(tile!, key), valueOf(objects!, ids), ids);
    if (decoded?.level !== undefined && decoded.level !== cell.level) throw new FarfieldError("corrupt", "the object ids belong to another cell", ids);
    return this.tiles.get(ids) ?? this.tiles.add(ids, decoded, 10 * (decoded?.ids.length ?? 0));
  }

  private async idsOf(cell: Cell, { key }: Resource, signal: AbortSignal): Promise<Uint32Array | null> {
    const ids = blockMapObjectsKey(cell.name, hashOf(key));
    const known = this.maps.get(ids);
    if (known !== undefined) return known;
    const [objects] = await this.fetch([ids], signal);
    const decoded = objects === null ? null : decodeBlockMapObjects(valueOf(objects!, ids), ids);
    return this.maps.get(ids) ?? this.maps.add(ids, decoded, decoded?.byteLength ?? 0);
  }

  /** Values of one cell, which are all on the same server. */
  private async fetch(keys: readonly string[], signal: AbortSignal): Promise<Found[]> {
    const found = await this.servers.of(keys[0]!).getMany(keys, signal);
    if (signal.aborted) throw new FarfieldError("aborted", "no longer wanted", keys[0]!);
    return found;
  }
}

/** A point in pitches from a tile's first column and row and from depth code 0. */
function placeIn(tile: ObjectTile, { grid, directions }: { readonly grid: Grid; readonly directions: Manifest["directions"] }, number: number, point: Vector3): Vector3 {
  const { axes } = directions.get(number)!;
  const pitch = grid.pitch(tile.level);
  const { corner } = grid;
  const [u, v, w] = along([point[0] - corner[0], point[1] - corner[1], point[2] - corner[2]], axes);
  return [u / pitch - tile.x, v / pitch - tile.y, w / pitch - tile.depthBase / 8];
}

/** The hash that ends a key. */
function hashOf(key: string): string {
  return key.slice(key.lastIndexOf("-") + 1);
}

/** The BlockMap of a cell, beside its views or in their place. */
function mapOf({ blockmap, views }: Cell): Resource | null {
  const [only] = [...views.values()].flatMap(({ layers }) => layers.filter((layer) => layer?.kind === "blockmap"));
  return blockmap?.leaf ?? only ?? null;
}
