import { corrupt } from "./errors.js";
import { formatKey, parseKey, type CellKey, type Grid } from "./grid.js";
import { dynamicBoard, impostorForm } from "./impostors.js";
import { listedPicks, type BlockMapEntry, type CellEntry, type GeometryLevel, type InstancedMesh, type MeshLevel } from "./indextile.js";
import { meshForm, placedMesh, type MeshForms, type PlacedMesh } from "./instances.js";
import { blockMapKey, dynamicOf, geometryKey, meshKey, orthoviewKey, textureKey } from "./keys.js";
import { Resource, type ResourceKind } from "./resource.js";
import { toldBy, UNTOLD_LOSS } from "./stream/accuracy.js";
import { grown, type Box } from "./vector.js";
import type { Pick } from "./views.js";

/** Pixels a kilobyte from which the gains of picked tiles go down, and steps by which they are halved (spec/world.md). */
const MOST_GAIN = 65536;
const STEPS = 4;
/** In place of a direction: from any, as a BlockMap shows it. */
const ANY_DIRECTION = -1;
/** Triangles of the box that a BlockMap is drawn by. */
const BOX = 12;
/** A splat reaches at most this many pitches from its middle. */
const SPLAT_REACH = 4;

/** One view of a cell: its layers, nearest first. */
export interface CellView {
  readonly direction: number;
  readonly layers: readonly Resource[];
}

/** What a cell needs to be drawn as geometry, at a level; above the leaves there are no meshes. */
export interface CellGeometry {
  readonly entry: GeometryLevel;
  /** 0 = full, of a cell above the leaves its finest, the larger the coarser. */
  readonly level: number;
  /** Triangles of the cell. */
  readonly leaf: Resource;
  readonly meshes: readonly Resource[];
}

/** Whether all of it is there. */
export function isHeld({ leaf, meshes }: CellGeometry): boolean {
  return leaf.held && meshes.every((mesh) => mesh.held);
}

/** The resource of a key: that of the generation before, where there is one. */
type Take = (key: string, kind: ResourceKind, bytes: number) => Resource;

/** One cell of the world as far as the index is known. */
export class Cell {
  readonly name: string;
  readonly level: number;
  /** The cell itself. */
  readonly box: Box;
  /** Which child of its parent it is (Grid.octant). */
  readonly octant: number;
  /** Tight bounds of what is in it; the cell's box until the index says more. */
  bounds: Box;
  /** The bounds with room for the splats on their border. */
  reach: Box;
  views: ReadonlyMap<number, CellView> = new Map();
  /** How unlike the full geometry its pictures look, 0 to 1 (CellEntry.errors). */
  told: readonly number[] = toldBy(undefined);
  /** How unlike its own pictures those of its parent look in their place. */
  loss = UNTOLD_LOSS;
  /** Of older worlds: for each view bin the directions to draw, best first. */
  bins: readonly (readonly number[])[] = [];
  /** For each view bin the tiles to draw, best first. */
  picks: readonly (readonly Pick[])[] = [];
  /** The tiles that it was drawn from when it was last complete or, while it has not been, from which it was drawn last. */
  shown: readonly Resource[] = [];
  /** Whether it has been complete. */
  wasWhole = false;
  /** Its own geometry in all forms, from fine to coarse; above the leaves that of everything below but for listed instances. */
  forms: readonly CellGeometry[] = [];
  /** Its BlockMap, where it has one beside its tiles; one in place of tiles is among `views`. */
  blockmap: CellGeometry | null = null;
  /** How much of what is to be seen of it instances take that leaves below list, 0 to 1 (GeometryEntry.listed). */
  listed = 0;
  /** What is placed in it, of a leaf whose index tells. */
  instances: readonly PlacedMesh[] = [];
  /** Cells below that hold something, ascending; null until the index is known that far down. */
  children: readonly Cell[] | null = null;
  /** Hash of the index tile that tells of the cells below; empty when this one's does. */
  indexHash = "";
  /** How many tiles of this cell and those below are held. */
  heldBelow = 0;
  /** Hash of the index tile that starts with this cell, once it has been read. */
  private readHash = "";

  /** The same cell of the generation before, until all that has not changed is taken over; null: there is none. */
  private before: Cell | null;

  constructor(
    readonly key: CellKey,
    public parent: Cell | null,
    private readonly grid: Grid,
    before: Cell | null = null,
  ) {
    // One whose index was never read has nothing to give but, perhaps, what was before it.
    this.before = before?.unread ? before.before : before;
    this.name = formatKey(key);
    this.level = key.level;
    this.box = grid.bounds(key);
    this.octant = grid.octant(key);
    this.bounds = this.reach = this.box;
  }

  /** Whether the index of what lies at or below this cell is still to be read. */
  get unread(): boolean {
    return this.indexHash !== "" && this.children === null;
  }

  /** Its own geometry in the finest form. */
  get geometry(): CellGeometry | null {
    return this.forms[0] ?? null;
  }

  /** The root it lies below, or is. */
  get root(): Cell {
    return this.parent ? this.parent.root : this;
  }

  /** Counts tiles of this cell that are held, or no longer. */
  count(change: number): void {
    for (let cell: Cell | null = this; cell; cell = cell.parent) cell.heldBelow += change;
  }

  /** Says which index tile starts with this cell. One that the generation before has read is not read again. */
  startsTile(hash: string): void {
    this.indexHash = hash;
    if (hash !== "" && this.before?.readHash === hash) this.inherit(this.before);
  }

  /** Takes what the index tile says of this cell, and of those below it that the tile knows. */
  read(entries: ReadonlyMap<string, CellEntry>, shared: SharedMeshes, where: string): void {
    const entry = entries.get(this.name);
    if (!entry) throw corrupt(`index tile without cell ${this.name}`, where);
    // The cell may have been read before, as the lowest of the tile above: its resources stay what they are.
    if (this.views.size === 0 && this.forms.length === 0) this.describe(entry, shared);
    const known = (entry.children ?? []).filter((name) => entries.has(name));
    if (entry.index && known.length === 0) {
      this.startsTile(entry.index);
      return;
    }
    const hash = this.indexHash;
    this.indexHash = "";
    this.children = known.map((name) => {
      const key = parseKey(name);
      // Else a cell could be reached on many ways, or be below itself, and a small index would never end.
      if (!this.grid.isChild(key, this.key)) throw corrupt(`cell ${name} is not below ${this.name}`, where);
      const before = this.before?.children?.find((cell) => cell.name === name) ?? null;
      const child = new Cell(key, this, this.grid, before);
      const loss = entry.losses?.[entry.children!.indexOf(name)];
      if (loss !== undefined) child.loss = loss / 255;
      child.read(entries, shared, where);
      return child;
    });
    this.readHash = hash;
    this.before = null;
  }

  private describe(entry: CellEntry, shared: SharedMeshes): void {
    this.bounds = { lower: entry.bounds[0], upper: entry.bounds[1] };
    this.reach = grown(this.bounds, SPLAT_REACH * entry.error);
    this.told = toldBy(entry.errors);
    this.bins = entry.views ?? [];
    const before = new Map(this.before?.resources.map((resource) => [resource.key, resource]));
    const take: Take = (key, kind, size) => {
      const found = before.get(key);
      found?.moveTo(this);
      return found ?? new Resource(key, kind, size, this);
    };
    const views = new Map<number, { direction: number; layers: Resource[] }>();
    for (const [direction, layer, bytes] of entry.tiles ?? []) {
      const view = views.get(direction) ?? { direction, layers: [] };
      view.layers[layer] = take(orthoviewKey(this.name, direction, layer, entry.hash ?? ""), "orthoview", bytes);
      views.set(direction, view);
    }
    if (entry.blockmap) this.describeBlockMap(entry.blockmap, views, take);
    this.views = views;
    this.picks = listedPicks(entry).map((flat) => this.picksOf(flat, entry));
    this.shown = this.before?.shown.filter(({ cell }) => cell === this) ?? [];
    this.wasWhole = this.before?.wasWhole === true && this.shown.length > 0 && this.shown.length === this.before.shown.length;
    this.describeGeometry(entry, shared, take);
    this.describeInstances(entry, shared);
    for (const resource of before.values()) resource.gone = resource.cell !== this;
  }

  private describeBlockMap({ hash, bytes, errors }: BlockMapEntry, views: Map<number, { direction: number; layers: Resource[] }>, take: Take): void {
    const leaf = take(blockMapKey(this.name, hash), "blockmap", bytes);
    if (views.size > 0) {
      this.blockmap = { entry: { hash, bytes, triangles: BOX, instances: 0, meshes: [], errors: errors ?? [] }, level: 0, leaf, meshes: [] };
      return;
    }
    this.told = toldBy(errors);
    views.set(ANY_DIRECTION, { direction: ANY_DIRECTION, layers: [leaf] });
  }

  private picksOf(flat: readonly number[], { tiles = [] }: CellEntry): Pick[] {
    const picks: Pick[] = [];
    let steps = 0;
    for (let n = 0; n < flat.length; n += 2) {
      const [direction, layer] = tiles[flat[n]!]!;
      steps += flat[n + 1]!;
      picks.push({ tile: this.views.get(direction)!.layers[layer]!, direction, layer, gain: MOST_GAIN * 2 ** (-steps / STEPS) });
    }
    return picks;
  }

  private describeGeometry({ geometry: near }: CellEntry, shared: SharedMeshes, take: Take): void {
    if (!near) return;
    this.listed = (near.listed ?? 0) / 255;
    this.forms = [near, ...(near.levels ?? [])].map((entry, level) => {
      const leaf = take(geometryKey(this.name, entry.hash), "geometry", entry.bytes);
      return { entry, level, leaf, meshes: entry.meshes.map(([hash, bytes]) => shared.get(hash, bytes)) };
    });
  }

  private describeInstances({ instances = [] }: CellEntry, shared: SharedMeshes): void {
    if (this.level > 0) return;
    const placed = instances.filter(({ objects }) => objects.length > 0);
    this.instances = placed.map((listed) => placedMesh(listed, this.box.lower, shared.formsOf(listed)));
  }

  /** What belongs to this cell alone, by its key. */
  find(key: string): Resource | null {
    return this.resources.find((resource) => resource.key === key) ?? null;
  }

  /** What belongs to this cell alone. */
  private get resources(): Resource[] {
    const tiles = [...this.views.values()].flatMap(({ layers }) => layers.filter(Boolean));
    return [...tiles, ...this.forms.map(({ leaf }) => leaf), ...(this.blockmap ? [this.blockmap.leaf] : [])];
  }

  /** Takes over everything at and below the same cell of the generation before: its index tile has not changed. */
  private inherit(before: Cell): void {
    if (this.views.size === 0 && this.forms.length === 0) {
      const { bounds, reach, told, views, bins, picks, shown, wasWhole, forms, blockmap, listed, instances } = before;
      Object.assign(this, { bounds, reach, told, views, bins, picks, shown, wasWhole, forms, blockmap, listed, instances });
      for (const resource of before.resources) resource.moveTo(this);
    }
    this.readHash = before.readHash;
    this.indexHash = "";
    this.before = null;
    this.children = before.children ?? [];
    for (const child of this.children) {
      child.parent = this;
      this.count(child.heldBelow);
    }
  }
}

/** The meshes that instances of several leaves share, and their images from round about, one resource each. */
export class SharedMeshes {
  private readonly known = new Map<string, Resource>();
  /** Of meshes that are placed by themselves, by what tells them apart. */
  private readonly inForms = new Map<string, MeshForms>();
  /** The same, and its bounds, by the hash of the full mesh. */
  private readonly byMesh = new Map<string, { readonly forms: MeshForms; readonly bounds: InstancedMesh["bounds"] }>();

  /** The resource of a key. One of a dynamic impostor is made, with its board, when it is first asked about. */
  find(key: string): Resource | null {
    return this.known.get(key) ?? this.dynamic(key);
  }

  private dynamic(key: string): Resource | null {
    const named = dynamicOf(key);
    const mesh = named && this.byMesh.get(named.mesh);
    const form = mesh?.forms.impostors.find(({ entry }) => entry.rows === named!.rows);
    if (!named || !mesh || !form) return null;
    // As large as those that are baked, until it has come.
    const resource = new Resource(key, "impostor", form.entry.images[0]![1], null, true);
    form.boards.push(dynamicBoard(mesh.bounds, resource, named));
    this.known.set(key, resource);
    return resource;
  }

  get(hash: string, bytes: number): Resource {
    return this.take(meshKey(hash), "mesh", bytes);
  }

  /** A mesh in all its forms, the same lists for all leaves that it is placed in. */
  formsOf(listed: InstancedMesh): MeshForms {
    const name = nameOf(listed);
    const found = this.inForms.get(name) ?? this.describe(listed);
    this.inForms.set(name, found);
    this.byMesh.set(listed.levels[0]!.hash, { forms: found, bounds: listed.bounds });
    return found;
  }

  private describe({ bounds, levels, impostors = [] }: InstancedMesh): MeshForms {
    return {
      forms: levels.map((entry, level) => meshForm(entry, level, this.withImages(entry))),
      impostors: impostors.map((entry) => impostorForm(entry, bounds, (hash, bytes) => this.take(textureKey(hash), "impostor", bytes))),
    };
  }

  private withImages({ hash, bytes, textures }: MeshLevel): Resource {
    const found = this.get(hash, bytes);
    if (textures?.length && found.images.size === 0) found.images = new Map(textures);
    return found;
  }

  private take(key: string, kind: ResourceKind, bytes: number): Resource {
    const found = this.known.get(key) ?? new Resource(key, kind, bytes, null);
    this.known.set(key, found);
    return found;
  }
}

/** The same for all leaves that a mesh is placed in. Where its boards stand, its bounds tell: the same images may be of a larger one. */
function nameOf({ bounds, levels, impostors }: InstancedMesh): string {
  const hashes = levels.map(({ hash }) => hash).join();
  return impostors?.length ? hashes + JSON.stringify([bounds, impostors]) : hashes;
}
