import { Cell, SharedMeshes } from "./cell.js";
import { asFarfieldError, corrupt, FarfieldError } from "./errors.js";
import { decodeIndexTile } from "./indextile.js";
import { formatKey } from "./grid.js";
import { cellOf, indexKey } from "./keys.js";
import type { Manifest } from "./manifest.js";
import type { Resource } from "./resource.js";
import type { Server, Servers } from "./servers.js";
import { valueOf, type Found } from "./source.js";

export interface WorldEvents {
  readonly bad: (key: string, error: FarfieldError, index: WorldIndex) => void;
  /** More of the index is known. */
  readonly grown: () => void;
}

/** Bytes of index tiles under way from a server at once, unless more is asked for: what is known of the picture is fetched beside them. */
const UNDER_WAY = 32 << 10;
/** Bytes that a tile is taken to have before any has come. */
const TILE_BYTES = 8 << 10;
/** Requests that share what is under way, where one can ask for several: while one is answered the next is asked. */
const SHARES = 2;

/** A world as far as its index has been read. */
export class WorldIndex {
  readonly roots: readonly Cell[];
  private readonly shared: SharedMeshes;
  private readonly loading: Set<Cell>;
  /** Of which the index is to be read next, the first first. */
  private waiting: readonly Cell[] = [];
  private room = UNDER_WAY;
  /** Of the tiles that have come. */
  private readonly come = { tiles: 1, bytes: TILE_BYTES };
  private readonly closing = new AbortController();

  constructor(
    readonly manifest: Manifest,
    private readonly servers: Servers,
    private readonly events: WorldEvents,
    before: WorldIndex | null = null,
  ) {
    this.shared = before?.shared ?? new SharedMeshes();
    this.loading = before?.loading ?? new Set();
    this.roots = manifest.roots.map(({ key, hash }) => {
      const name = formatKey(key);
      const root = new Cell(key, null, manifest.grid, before?.roots.find((cell) => cell.name === name) ?? null);
      root.startsTile(hash);
      return root;
    });
  }

  /**
   * The index of another generation of this world, whose cells have the same places: it takes over what has not changed,
   * and this one keeps what it needs to be drawn until it is closed.
   */
  followedBy(manifest: Manifest): WorldIndex {
    return new WorldIndex(manifest, this.servers, this.events, this);
  }

  /** What is drawn from the value of a key; null: nothing, as far as the index has been read. */
  find(key: string): Resource | null {
    const of = cellOf(key);
    if (!of) return this.shared.find(key);
    const { grid } = this.manifest;
    const isAbove = ({ level, name }: Cell): boolean => level >= of.level && name === formatKey(grid.ancestor(of, level));
    let cell = this.roots.find(isAbove);
    while (cell && cell.level > of.level) cell = cell.children?.find(isAbove);
    return cell?.find(key) ?? null;
  }

  /** Number of index tiles that are under way or will be. */
  get pending(): number {
    return this.loading.size + this.waiting.length;
  }

  /** Whether the index below a cell is still to be read, and can be. */
  isDue(cell: Cell): boolean {
    return cell.unread && !this.servers.isAway(keyOf(cell));
  }

  /**
   * Reads the index below cells, in the order given and instead of what waited before; what is being read already goes on. `room`:
   * bytes that may be under way from a server, by what tiles have had so far.
   */
  explore(cells: readonly Cell[], room = UNDER_WAY): void {
    this.waiting = [...new Set(cells)];
    this.room = Math.max(room, UNDER_WAY);
    this.pump();
  }

  close(): void {
    this.closing.abort();
  }

  /** Asks for as much of what waits as there is room for. */
  private pump(): void {
    const due = new Map<Server, Cell[]>();
    for (const cell of this.waiting) {
      if (!cell.indexHash || this.loading.has(cell)) continue;
      const server = this.servers.of(keyOf(cell));
      if (server.reachable) due.set(server, [...(due.get(server) ?? []), cell]);
    }
    const tiles = Math.max(Math.floor((this.room * this.come.tiles) / this.come.bytes), 1);
    for (const [server, list] of due) {
      const share = Math.min(server.source.batchKeys, Math.ceil(tiles / SHARES));
      for (let free = tiles - this.underWay(server); free > 0 && list.length > 0; free -= share) {
        void this.load(server, list.splice(0, Math.min(share, free)));
      }
    }
    this.waiting = [...due.values()].flat();
  }

  private underWay(server: Server): number {
    let count = 0;
    for (const cell of this.loading) if (this.servers.of(keyOf(cell)) === server) count++;
    return count;
  }

  private async load(server: Server, cells: readonly Cell[]): Promise<void> {
    for (const cell of cells) this.loading.add(cell);
    const keys = cells.map(keyOf);
    try {
      const answers = await server.getMany(keys, this.closing.signal);
      cells.forEach((cell, n) => this.read(cell, keys[n]!, answers[n]!));
    } catch (thrown) {
      const error = asFarfieldError(thrown, keys[0]!);
      if (error.tag !== "aborted") server.failed(error.what);
    } finally {
      for (const cell of cells) this.loading.delete(cell);
      if (!this.closing.signal.aborted) {
        this.events.grown();
        this.pump();
      }
    }
  }

  /** Reads one index tile; a cell whose index is missing or damaged ends there and stays a picture. */
  private read(cell: Cell, key: string, found: Found): void {
    if (!cell.unread) return;
    try {
      const tile = valueOf(found, key);
      this.come.tiles++;
      this.come.bytes += tile.length;
      cell.read(new Map(decodeIndexTile(tile, key).map((entry) => [entry.key, entry])), this.shared, key);
    } catch (thrown) {
      cell.indexHash = "";
      cell.children = [];
      this.events.bad(key, thrown instanceof FarfieldError ? thrown : corrupt(String(thrown), key), this);
    }
  }
}

/** Key of the index tile that tells of what lies below a cell. */
function keyOf({ name, indexHash }: Cell): string {
  return indexKey(name, indexHash);
}
