import type { Cell } from "../cell.js";
import { accuracyOf, finestAfar, formsOf, instancesBelow, isWithinReach, ownForms, pixelWidth, unreadBelow, type CellForm } from "../cellforms.js";
import { outsideOf, type Instance, type MeshForm, type PlacedMesh } from "../instances.js";
import type { Direction } from "../manifest.js";
import type { Resource } from "../resource.js";
import { distanceTo, type Box, type Vector3 } from "../vector.js";
import { sharesOf, tilesWanted, type ViewChoice } from "../views.js";
import { lossFrom, pictureAccuracy } from "./accuracy.js";
import { MeshParts, sideOf, type MeshPart, type PlacedRow, type Seen } from "./meshes.js";
import type { Prediction } from "./motion.js";
import { partsOf, SHARES, type Offer, type Offering, type Shown, type Use } from "./offers.js";
import type { Outlook } from "./outlook.js";

/** Seconds for which cells are made out fine enough for where the viewer will be. */
const AHEAD = 8;
/** Places on that way. */
const STEPS = 4;
/** Cells that are offered as one, at most. */
const TOGETHER = 64;
/** Pixels of the screen for one of a picture, up to which instances are seen in it as well as all else is; in a coarser one less. */
const SHARP = 1;
/** Accuracy by which geometry must show more than a cell's pictures that are all there, to be sent as well. */
const MORE = 0.05;
/** Share of `leastGain` that geometry must add: it is sent last. */
const WORTH = 0.1;
/** Share of a cell's pictures that are there, from which on what lies below is asked about: what there is to see at once comes first. */
const SHOWN = 0.5;
/** Share of what is seen of cells by which leaves that are not known could show more than the pictures of a cell above, for the index to be read. */
const WORTH_READING = 0.005;
/** Importance of an instance beside that of a cell. */
const OBJECTS = 4;

/** Pictures or geometry of a cell, or a mesh of instances, or an image of it. */
export interface Part {
  /** The first, of several whose geometry shares meshes or images; of a mesh that in which most of it is seen. */
  readonly cell: Cell;
  readonly isGeometry: boolean;
  /** Hash of the full mesh that it is a form or an image of, placed by itself; null: it is none. */
  readonly mesh: string | null;
  /** All that it shows as geometry. */
  readonly cells: readonly Cell[];
  /** What of it is still to come, best first. */
  readonly resources: readonly Resource[];
}

/** Geometry of a cell in one of its forms, and the objects that it shows: the cell or, by its own forms, those below it. */
interface Formed {
  readonly cell: Cell;
  readonly form: CellForm;
  readonly uses: readonly Use[];
  readonly lacks: readonly Lacking[];
}

/** A cell that will be seen. */
interface SeenCell {
  readonly object: number;
  readonly seen: Seen;
}

/** An instance that may be seen, as an object of its own. */
interface Placed {
  /** Place in the list of cells of that which it lies in. */
  readonly home: number;
  readonly of: PlacedMesh;
  readonly instance: Instance;
  readonly bounds: Box;
}

/** What of a form is not there. */
interface Lacking {
  readonly name: string;
  readonly bytes: number;
  /** Whether other cells' geometry may need it, too. */
  readonly isShared: boolean;
}

interface Found {
  readonly offers: Offer<Part>[];
  readonly shown: Shown[];
}

/** What cells are chosen from, and how they are drawn. */
export interface CellsView {
  readonly roots: readonly Cell[];
  readonly directions: ReadonlyMap<number, Direction>;
  readonly grid: { readonly leafSize: number; readonly resolution: number };
  /** Metres from which a leaf is fine enough. */
  readonly radius: number;
  /** Leaves nearer than this are geometry. */
  readonly near: number;
  /** Near leaves are left out. */
  readonly farOnly: boolean;
  /** Cells farther away are geometry too, in place of their pictures, where that shows more for its bytes. */
  readonly farGeometry: boolean;
  readonly choice: ViewChoice;
  /** Whether an image of near geometry is there. */
  readonly holdsImage: (hash: string) => boolean;
  /** Tells what cannot be had. */
  readonly lacks: (resource: Resource) => boolean;
}

/**
 * Cells by their pictures and as geometry, and those above them, and instances by their meshes, as things to fetch; the twin of
 * `farfield.stream.pictures`. A cell is offered by the first of the tiles that are wanted of it, as far as some shares of what all of
 * them show.
 */
export class Pictures implements Offering<Part> {
  private cells: readonly Cell[] = [];
  private placed: readonly Placed[] = [];
  /** What is on its way, or has come and cannot be drawn yet, and would show something better, as of the last offers. */
  coming: readonly Part[] = [];
  /**
   * Cells of whose pictures most are there and below which the index has not been read, though geometry of leaves there might show
   * enough more; as of the last offers, those with most to show first. The cut itself needs nothing below them.
   */
  get unknown(): readonly Cell[] {
    return this.worthwhile.flatMap(unreadBelow);
  }

  private worthwhile: readonly Cell[] = [];

  constructor(private readonly view: () => CellsView) {}

  /** The coarsest cells that are fine enough from all of the way ahead; together they cover the world once. */
  boxes(prediction: Prediction, seconds: number): readonly Box[] {
    const way = Math.min(seconds, AHEAD);
    const eyes = Array.from({ length: STEPS }, (_, n) => prediction.eye((way * n) / (STEPS - 1)));
    this.cells = regions(this.view(), eyes);
    this.placed = this.instances(eyes[0]!);
    return [...this.cells, ...this.placed].map(({ bounds }) => bounds);
  }

  /** Rectangles of cells overlap, and add up to several pictures; those of instances do not. */
  importance({ visible, eyes, pixels }: Outlook): readonly number[] {
    const ofCells = visible.subarray(0, this.cells.length * eyes.length).reduce((sum, one) => sum + one, 0);
    const factor = OBJECTS * Math.max(ofCells / (pixels * eyes.length), 1);
    return [...this.cells.map(() => 1), ...this.placed.map(() => factor)];
  }

  private instances(eye: Vector3): Placed[] {
    const { near, farOnly, farGeometry, grid } = this.view();
    if (near <= 0) return [];
    return this.cells.flatMap((cell, home) => {
      const below = farGeometry || (cell.level === 0 && !farOnly) ? instancesBelow(cell) : [];
      const isLeftOut = farOnly && cell.level === 0 && distanceTo(cell.bounds, eye) < near;
      return below.flatMap((of) => of.instances.flatMap((instance) => {
        // What reaches out of leaves that are left out is seen there.
        const bounds = isLeftOut ? outsideOf(instance.bounds, of.corner, grid.leafSize, (leaf) => distanceTo(leaf, eye) < near) : instance.bounds;
        return bounds ? [{ home, of, instance, bounds }] : [];
      }));
    });
  }

  offers(outlook: Outlook): Found {
    const { near, farOnly } = this.view();
    const uses = new Map<Cell, Use[]>();
    const geometry: Formed[] = [];
    const below = new Map<Cell, SeenCell[]>();
    const unknown: { readonly cell: Cell; readonly worth: number }[] = [];
    this.cells.forEach((cell, object) => {
      const seen = this.seenFrom(cell.bounds, object, outlook);
      if (!seen || (farOnly && seen.away.every((metres) => metres < near))) return;
      this.addChain(uses, cell, object, seen, false);
      const isWhole = this.isWhole(cell, seen, outlook.eyes[0]!);
      geometry.push(...this.geometryOf(cell, object, seen, isWhole, outlook));
      unknown.push({ cell, worth: this.worthOfLeaves(cell, object, seen, outlook) });
      if (!isWhole) addBelow(below, cell, { object, seen });
    });
    const all = this.cells.reduce((sum, _, object) => sum + outlook.visible[object * outlook.eyes.length]!, 0);
    const worthwhile = unknown.filter(({ worth }) => worth >= WORTH_READING * all).sort((a, b) => b.worth - a.worth);
    this.worthwhile = worthwhile.map(({ cell }) => cell);
    geometry.push(...[...below].flatMap(([above, cells]) => this.standInsOf(above, cells)));
    this.placed.forEach(({ home, bounds }, n) => {
      const seen = this.seenFrom(bounds, this.cells.length + n, outlook);
      if (seen) this.addChain(uses, this.cells[home]!, this.cells.length + n, seen, true);
    });
    const rows = [...this.placedRows(outlook)];
    const parts = new MeshParts(outlook, this.pitch, this.view().farGeometry);
    const meshes = [...rows.flatMap(([forms, own]) => parts.levelsOf(forms, own)), ...rows.flatMap(([, own]) => parts.boardsOf(own))];
    this.coming = betterComing([
      ...[...uses].map(([cell, shows]) => ({ ...pictureOf(cell, this.tilesOf(cell, outlook.eyes[0]!)), uses: shows })),
      ...geometry.map(({ cell, form, uses }) => ({ cell, isGeometry: true, mesh: null, cells: [cell], resources: form.resources, uses })),
      ...meshes.map((one) => ({ ...one, ...asPart(one, one.resources) })),
    ]);
    const found: Found = { offers: [], shown: [] };
    for (const [cell, shows] of uses) this.addPictures(found, cell, outlook.eyes[0]!, shows);
    for (const one of geometry) this.addGeometry(found, [one]);
    this.addTogether(found, geometry, outlook);
    for (const mesh of meshes) this.addMesh(found, mesh);
    return found;
  }

  /** Where an object will be seen from; null: it will not be. */
  private seenFrom(bounds: Box, object: number, { visible, eyes, focal }: Outlook): Seen | null {
    if (!visible.subarray(object * eyes.length, (object + 1) * eyes.length).some((pixels) => pixels > 0)) return null;
    const away = eyes.map((eye) => distanceTo(bounds, eye));
    return { away, widths: away.map((metres) => pixelWidth(bounds, metres, focal)) };
  }

  /**
   * What a cell and all above it would show of an object in it: from link to link something is lost, and of instances sharpness, which
   * their surroundings do not miss.
   */
  private addChain(uses: Map<Cell, Use[]>, cell: Cell, object: number, { away, widths }: Seen, isInstance: boolean): void {
    const { near, farOnly } = this.view();
    const { pitch } = this;
    let accuracy = away.map((metres, k) => (farOnly && metres < near ? 0 : this.picturesOf(cell, widths[k]!)));
    for (let above: Cell | null = cell; above; above = above.parent) {
      const own = pitch * 2 ** above.level;
      const shown = isInstance ? accuracy.map((one, k) => one * Math.min((SHARP * widths[k]!) / own, 1)) : accuracy;
      const use = { object, accuracy: shown };
      if (above.views.size > 0) uses.set(above, [...(uses.get(above) ?? []), use]);
      const { loss, level } = above;
      accuracy = accuracy.map((own, k) => own * (1 - lossFrom(loss, (pitch * 2 ** (level + 1)) / widths[k]!)));
    }
  }

  private get pitch(): number {
    const { leafSize, resolution } = this.view().grid;
    return leafSize / resolution;
  }

  /** Whether all pictures of a cell that is not near are there. */
  private isWhole(cell: Cell, { away }: Seen, eye: Vector3): boolean {
    const { near, farOnly } = this.view();
    const isEverNear = cell.level === 0 && cell.geometry !== null && away.some((metres) => metres < near);
    return (!isEverNear || farOnly) && this.heldShare(cell, eye) >= 1 - 1e-6;
  }

  /** Pixels' worth that the leaves below a cell could show, as geometry, and its pictures do not: all that these err by. */
  private worthOfLeaves(cell: Cell, object: number, { away, widths }: Seen, { visible, eyes }: Outlook): number {
    const { near, farGeometry, grid } = this.view();
    if (cell.level === 0 || near <= 0 || !farGeometry || !isWithinReach(away[0]!, grid.leafSize)) return 0;
    if (this.heldShare(cell, eyes[0]!) < SHOWN) return 0;
    return (1 - this.picturesOf(cell, widths[0]!)) * visible[object * eyes.length]!;
  }

  /** How well a cell's own pictures show it where a pixel is so many metres wide. */
  private picturesOf({ told, level }: Cell, width: number): number {
    return pictureAccuracy(told, (this.pitch * 2 ** level) / width);
  }

  /** Forms of a near leaf, and of what is farther where they are fewer bytes than its pictures, or worth theirs. */
  private geometryOf(cell: Cell, object: number, { away, widths }: Seen, isWhole: boolean, { visible, eyes }: Outlook): Formed[] {
    const { near, farOnly, farGeometry, grid, choice } = this.view();
    if (near <= 0) return [];
    const isNear = away.map((metres) => cell.level === 0 && cell.geometry !== null && metres < near);
    const isEverNear = isNear.some(Boolean);
    if (farOnly ? !farGeometry : !isEverNear && !farGeometry) return [];
    const tiles = this.tilesOf(cell, eyes[0]!);
    const cost = tiles.length > 0 ? bytesOf(tiles) : Infinity;
    return formsOf(cell, grid.resolution).flatMap((form) => {
      const isFar = farGeometry && form.far;
      const accuracy = away.map((metres, k) => {
        const may = isNear[k] ? !farOnly : isFar && (form.own || isWithinReach(metres, grid.leafSize));
        return may ? accuracyOf(form, cell, this.pitch, widths[k]!) : 0;
      });
      if (!accuracy.some((one) => one > 0)) return [];
      const lacks = this.lacking(form.resources, form.images);
      // Instances are seen by the pictures, and would be missed.
      const isAlone = !form.own || instancesBelow(cell).length === 0;
      const own = form.leaves.reduce((sum, { entry }) => sum + entry.bytes, 0);
      // As a tile does, it has to add enough for each kilobyte of its own, what others refer to left out.
      const isWorth = accuracy.some((one, k) => {
        const gain = one - this.picturesOf(cell, widths[k]!);
        return gain >= MORE && gain * visible[object * eyes.length + k]! >= (WORTH * choice.leastGain * own) / 1000;
      });
      const comes = isWhole
        ? isAlone && isWorth
        : // What is placed in a cell that is farther comes first, level by level.
          isEverNear || (form.listed.every(({ state }) => state !== "absent") && (isWorth || own <= cost));
      return !comes && lacks.length > 0 ? [] : [{ cell, form, uses: [{ object, accuracy }], lacks }];
    });
  }

  /** Own forms of a cell above some that will be seen, and are not there: they stand in for these. */
  private standInsOf(above: Cell, cells: readonly SeenCell[]): Formed[] {
    const { near, farGeometry } = this.view();
    if (near <= 0 || !farGeometry) return [];
    return ownForms(above).map((form) => {
      const uses = cells.map(({ object, seen: { widths } }) => ({
        object,
        accuracy: widths.map((width) => accuracyOf(form, above, this.pitch, width)),
      }));
      return { cell: above, form, uses, lacks: this.lacking(form.resources, form.images) };
    });
  }

  private heldShare(cell: Cell, eye: Vector3): number {
    const tiles = this.tilesOf(cell, eye);
    const shares = sharesOf(cell, tiles, eye);
    return tiles.reduce((sum, { state }, n) => sum + (state === "absent" || state === "bad" ? 0 : shares[n]!), 0);
  }

  /**
   * Geometry of several cells as one, level by level, where they lack the same: each alone would pay for it. Of those that are seen
   * largest, then of twice as many, up to TOGETHER.
   */
  private addTogether(found: Found, geometry: readonly Formed[], { visible, eyes }: Outlook): void {
    const pixels = (object: number): number => visible.subarray(object * eyes.length, (object + 1) * eyes.length).reduce((sum, one) => sum + one, 0);
    for (let level = 0; level <= Math.max(...geometry.map(({ form }) => form.level)); level++) {
      const own = geometry
        .filter(({ form }) => form.level === level && !form.resources.some(this.view().lacks))
        .map((one) => ({ one, lacks: one.lacks.filter(({ isShared }) => isShared), seen: pixels(one.uses[0]!.object) }))
        .filter(({ lacks }) => lacks.length > 0);
      const all = own.flatMap(({ lacks }) => lacks);
      if (new Set(all.map(({ name }) => name)).size === all.length) continue;
      const sorted = [...own].sort((a, b) => b.seen - a.seen).slice(0, TOGETHER).map(({ one }) => one);
      for (let count = 2; count / 2 < sorted.length; count *= 2) this.addGeometry(found, sorted.slice(0, count));
    }
  }

  private tilesOf(cell: Cell, eye: Vector3): readonly Resource[] {
    const { directions, choice } = this.view();
    return tilesWanted(cell, directions, eye, choice);
  }

  /** Offers what is not there of a cell's tiles, in steps, as far as it can be had; takes note of what is. */
  private addPictures({ offers, shown }: Found, cell: Cell, eye: Vector3, uses: readonly Use[]): void {
    const { lacks } = this.view();
    const tiles = this.tilesOf(cell, eye);
    const shares = sharesOf(cell, tiles, eye);
    const held = this.heldShare(cell, eye);
    if (partsOf(held) > 0) shown.push(...uses.map((use) => ({ ...use, parts: partsOf(held) })));
    const absent = tiles.filter((tile) => tile.state === "absent" && !lacks(tile));
    const series = {};
    let count = 0;
    for (const end of steps(shares)) {
      const resources = absent.filter((tile) => tiles.indexOf(tile) < end);
      if (resources.length === count) continue;
      count = resources.length;
      const whole = count === absent.length && absent.length === tiles.filter(({ state }) => state === "absent").length;
      const parts = partsOf(whole ? 1 : resources.reduce((sum, tile) => sum + shares[tiles.indexOf(tile)]!, held));
      offers.push({ item: pictureOf(cell, resources), size: bytesOf(resources), uses, parts, series });
    }
  }

  /** Offers what is not there of the geometry of cells, unless a part of it cannot be had: it is all or nothing. */
  private addGeometry({ offers, shown }: Found, formed: readonly Formed[]): void {
    const all = [...new Set(formed.flatMap(({ form }) => form.resources))];
    if (all.some(this.view().lacks)) return;
    const lacking = new Map(formed.flatMap(({ lacks }) => lacks).map(({ name, bytes }) => [name, bytes]));
    const uses = formed.flatMap(({ uses }) => uses);
    const cells = formed.map(({ cell }) => cell);
    const resources = all.filter(({ state }) => state === "absent");
    const size = [...lacking.values()].reduce((sum, bytes) => sum + bytes, 0);
    if (lacking.size === 0) shown.push(...uses.map((use) => ({ ...use, parts: SHARES.length })));
    else offers.push({ item: { cell: cells[0]!, isGeometry: true, mesh: null, cells, resources }, size, uses, parts: SHARES.length, series: {} });
  }

  /** Instances that will be seen, by the forms of their mesh. Where all pictures are there, they are drawn by these. */
  private placedRows(outlook: Outlook): ReadonlyMap<readonly MeshForm[], readonly PlacedRow[]> {
    const { near, farGeometry, grid } = this.view();
    const { eyes, visible } = outlook;
    const isNear = (cell: Cell, metres: number): boolean => cell.level === 0 && cell.geometry !== null && metres < near;
    const homes = this.cells.map((cell) => ({ cell, away: eyes.map((eye) => distanceTo(cell.bounds, eye)) }));
    const isWhole = new Map<Cell, boolean>();
    const byMesh = new Map<readonly MeshForm[], PlacedRow[]>();
    this.placed.forEach(({ home, of, instance, bounds }, n) => {
      const object = this.cells.length + n;
      const seen = this.seenFrom(bounds, object, outlook);
      if (!seen) return;
      const { cell, away } = homes[home]!;
      const near = away.map((metres) => isNear(cell, metres));
      if (!isWhole.has(cell)) isWhole.set(cell, !near.some(Boolean) && this.heldShare(cell, eyes[0]!) >= 1 - 1e-6);
      if (isWhole.get(cell)) return;
      const pixels = visible.subarray(object * eyes.length, (object + 1) * eyes.length).reduce((sum, one) => sum + one, 0);
      const rows = byMesh.get(of.forms) ?? [];
      const from = farGeometry ? finestAfar(cell, grid.resolution) : Infinity;
      rows.push({ of, instance, seen, near, from, object, cell, pixels, side: sideOf(bounds) });
      byMesh.set(of.forms, rows);
    });
    return byMesh;
  }

  /** Offers a form or an image of a mesh that is not there, as far as it can be had. */
  private addMesh({ offers, shown }: Found, part: MeshPart): void {
    const { images, uses, resources } = part;
    if (resources.some(this.view().lacks)) return;
    const lacks = this.lacking(resources, images);
    const size = lacks.reduce((sum, { bytes }) => sum + bytes, 0);
    if (lacks.length === 0) shown.push(...uses.map((use) => ({ ...use, parts: SHARES.length })));
    else offers.push({ item: asPart(part, resources.filter(({ state }) => state === "absent")), size, uses, parts: SHARES.length, series: {} });
  }

  /** What of a form is not there, its images too, by name. */
  private lacking(all: readonly Resource[], images: ReadonlyMap<string, number>): Lacking[] {
    const resources = all.filter(({ state }) => state === "absent");
    const absent = [...images].filter(([hash]) => !this.view().holdsImage(hash));
    return [
      ...resources.map(({ key, bytes, kind }) => ({ name: key, bytes, isShared: kind !== "geometry" })),
      ...absent.map(([hash, bytes]) => ({ name: hash, bytes, isShared: true })),
    ];
  }
}

function addBelow(below: Map<Cell, SeenCell[]>, cell: Cell, seen: SeenCell): void {
  for (let { parent } = cell; parent; { parent } = parent) {
    if (parent.forms.length === 0) continue;
    const known = below.get(parent);
    if (known) known.push(seen);
    else below.set(parent, [seen]);
  }
}

function asPart({ cell, mesh }: MeshPart, resources: readonly Resource[]): Part {
  return { cell, isGeometry: true, mesh, cells: [], resources };
}

function pictureOf(cell: Cell, resources: readonly Resource[]): Part {
  return { cell, isGeometry: false, mesh: null, cells: [], resources };
}

/** What is coming of parts that show an object better than those that are there. */
function betterComing(parts: readonly (Part & { readonly uses: readonly Use[] })[]): Part[] {
  const best = new Map<number, number>();
  for (const { resources, uses } of parts) {
    if (resources.length === 0 || !resources.every(({ held }) => held)) continue;
    for (const { object, accuracy } of uses) best.set(object, Math.max(best.get(object) ?? 0, accuracy[0]!));
  }
  const isBetter = ({ object, accuracy }: Use): boolean => accuracy[0]! > (best.get(object) ?? 0);
  return parts.flatMap(({ cell, isGeometry, mesh, cells, resources, uses }) => {
    const coming = resources.filter((resource) => resource.coming);
    return coming.length > 0 && uses.some(isBetter) ? [{ cell, isGeometry, mesh, cells, resources: coming }] : [];
  });
}

function bytesOf(resources: readonly Resource[]): number {
  return resources.reduce((sum, { bytes }) => sum + bytes, 0);
}

/** How many tiles, best first, show each of SHARES of the whole. */
function steps(shares: readonly number[]): Set<number> {
  let sum = 0;
  const reached = shares.map((share) => (sum += share));
  return new Set(SHARES.map((share) => reached.findIndex((one) => one >= share - 1e-6) + 1));
}

function regions({ roots, radius, near }: CellsView, eyes: readonly Vector3[]): Cell[] {
  const found: Cell[] = [];
  const visit = (cell: Cell): void => {
    const away = Math.min(...eyes.map((eye) => distanceTo(cell.box, eye)));
    const isFine = cell.level === 0 || !cell.children?.length || (away >= radius * 2 ** cell.level && away >= near);
    if (isFine) found.push(cell);
    else cell.children!.forEach(visit);
  };
  roots.forEach(visit);
  return found;
}
