import type { Cell } from "../cell.js";
import type { Direction } from "../manifest.js";
import type { Resource } from "../resource.js";
import { distanceTo, type Box, type Vector3 } from "../vector.js";
import { sharesOf, tilesWanted, type ViewChoice } from "../views.js";
import { pictureAccuracy } from "./accuracy.js";
import type { Prediction } from "./motion.js";
import { partsOf, SHARES, type Offer, type Offering, type Shown, type Use } from "./offers.js";
import type { Outlook } from "./outlook.js";

/** Seconds for which cells are made out fine enough for where the viewer will be. */
const AHEAD = 8;
/** Places on that way. */
const STEPS = 4;

/** Of the diagonal of what is in a cell: what is in it is not nearer than that, on the whole, to who stands in it. */
const INSIDE = 1 / 16;

/** Pictures or geometry of a cell. */
export interface Part {
  /** The first, of several leaves whose geometry shares meshes. */
  readonly cell: Cell;
  readonly isGeometry: boolean;
  /** What of it is still to come, best first. */
  readonly resources: readonly Resource[];
}

interface Found {
  readonly offers: Offer<Part>[];
  readonly shown: Shown[];
}

/** What cells are chosen from, and how they are drawn. */
export interface CellsView {
  readonly roots: readonly Cell[];
  readonly directions: ReadonlyMap<number, Direction>;
  /** Metres between the pixels of a leaf's pictures. */
  readonly pitch: number;
  /** Metres from which a leaf is fine enough. */
  readonly radius: number;
  /** Leaves nearer than this are geometry. */
  readonly near: number;
  /** Near leaves are left out. */
  readonly farOnly: boolean;
  readonly choice: ViewChoice;
  /** Tells what cannot be had. */
  readonly lacks: (resource: Resource) => boolean;
}

/**
 * Cells by their pictures and as geometry, and those above them, as things to fetch; the twin of `farfield.stream.pictures`. A cell
 * is offered by the first of the tiles that are wanted of it, as far as some shares of what all of them show.
 */
export class Pictures implements Offering<Part> {
  private cells: readonly Cell[] = [];
  private useful: { pictures: ReadonlySet<Cell>; geometry: ReadonlySet<Cell> } = { pictures: new Set(), geometry: new Set() };

  constructor(private readonly view: () => CellsView) {}

  /** The coarsest cells that are fine enough from all of the way ahead; together they cover the world once. */
  boxes(prediction: Prediction, seconds: number): readonly Box[] {
    const way = Math.min(seconds, AHEAD);
    const eyes = Array.from({ length: STEPS }, (_, n) => prediction.eye((way * n) / (STEPS - 1)));
    this.cells = regions(this.view(), eyes);
    return this.cells.map(({ bounds }) => bounds);
  }

  offers(outlook: Outlook): Found {
    const { near, pitch, farOnly } = this.view();
    const intervals = outlook.eyes.length;
    const uses = new Map<Cell, Use[]>();
    const geometry: [Cell, Use][] = [];
    this.cells.forEach((cell, object) => {
      const away = outlook.eyes.map((eye) => distanceTo(cell.bounds, eye));
      const inner = INSIDE * diagonalOf(cell.bounds) + 1e-9;
      const own = outlook.visible.subarray(object * intervals, (object + 1) * intervals);
      if (!own.some((pixels) => pixels > 0) || (farOnly && away.every((metres) => metres < near))) return;
      for (let above: Cell | null = cell; above; above = above.parent) {
        if (above.views.size === 0) continue;
        const apart = outlook.focal * pitch * 2 ** above.level;
        const accuracy = away.map((metres) => (farOnly && metres < near ? 0 : pictureAccuracy(apart / Math.max(metres, inner))));
        const use = { object, accuracy };
        uses.set(above, [...(uses.get(above) ?? []), use]);
      }
      if (!farOnly && cell.geometry && away.some((metres) => metres < near)) {
        geometry.push([cell, { object, accuracy: away.map((metres) => (metres < near ? 1 : 0)) }]);
      }
    });
    this.useful = { pictures: new Set(uses.keys()), geometry: new Set(geometry.map(([cell]) => cell)) };
    const found: Found = { offers: [], shown: [] };
    for (const [cell, shows] of uses) this.addPictures(found, cell, outlook.eyes[0]!, shows);
    for (const [cell, shows] of geometry) this.addGeometry(found, cell, [shows], partsOfGeometry(cell));
    const together = geometry.filter(([cell]) => !partsOfGeometry(cell).some(this.view().lacks));
    const all = together.flatMap(([cell]) => partsOfGeometry(cell)).filter(({ state }) => state === "absent");
    // Where they lack the same meshes, each for itself would pay for all of them.
    if (new Set(all).size < all.length) this.addGeometry(found, together[0]![0], together.map(([, shows]) => shows), [...new Set(all)]);
    return found;
  }

  /** Whether pictures or geometry of a cell would show something, as of the last offers. */
  isUseful({ cell, isGeometry }: Pick<Part, "cell" | "isGeometry">): boolean {
    return this.useful[isGeometry ? "geometry" : "pictures"].has(cell);
  }

  /** Offers what is not there of a cell's tiles, in steps, as far as it can be had; takes note of what is. */
  private addPictures({ offers, shown }: Found, cell: Cell, eye: Vector3, uses: readonly Use[]): void {
    const { directions, choice, lacks } = this.view();
    const tiles = tilesWanted(cell, directions, eye, choice);
    const shares = sharesOf(cell, tiles, eye);
    const held = tiles.reduce((sum, { state }, n) => sum + (state === "absent" || state === "bad" ? 0 : shares[n]!), 0);
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
      offers.push({ item: { cell, isGeometry: false, resources }, size: bytesOf(resources), uses, parts, series });
    }
  }

  /** Offers what is not there of the geometry of leaves, unless a part of it cannot be had: it is all or nothing. */
  private addGeometry({ offers, shown }: Found, cell: Cell, uses: readonly Use[], all: readonly Resource[]): void {
    if (all.some(this.view().lacks)) return;
    const resources = all.filter(({ state }) => state === "absent");
    if (resources.length === 0) shown.push(...uses.map((use) => ({ ...use, parts: SHARES.length })));
    else offers.push({ item: { cell, isGeometry: true, resources }, size: bytesOf(resources), uses, parts: SHARES.length, series: {} });
  }
}

function partsOfGeometry({ geometry }: Cell): readonly Resource[] {
  return [geometry!.leaf, ...geometry!.meshes];
}

function diagonalOf({ lower, upper }: Box): number {
  return Math.hypot(upper[0] - lower[0], upper[1] - lower[1], upper[2] - lower[2]);
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
