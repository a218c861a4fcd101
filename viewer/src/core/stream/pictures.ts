import type { Cell } from "../cell.js";
import type { Direction } from "../manifest.js";
import type { Resource } from "../resource.js";
import { distanceTo, type Box, type Vector3 } from "../vector.js";
import { tilesWanted, type ViewChoice } from "../views.js";
import { pictureAccuracy } from "./accuracy.js";
import type { Prediction } from "./motion.js";
import type { Offer, Offering, Use } from "./offers.js";
import type { Outlook } from "./outlook.js";

/** Seconds for which cells are made out fine enough for where the viewer will be. */
const AHEAD = 8;
/** Places on that way. */
const STEPS = 4;

/** Pictures or geometry of a cell. */
export interface Part {
  readonly cell: Cell;
  readonly isGeometry: boolean;
  /** What of it is still to come, best first. */
  readonly resources: readonly Resource[];
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
 * is shown once all the tiles that are wanted of it are there.
 */
export class Pictures implements Offering<Part> {
  private cells: readonly Cell[] = [];

  constructor(private readonly view: () => CellsView) {}

  /** The coarsest cells that are fine enough from all of the way ahead; together they cover the world once. */
  boxes(prediction: Prediction, seconds: number): readonly Box[] {
    const way = Math.min(seconds, AHEAD);
    const eyes = Array.from({ length: STEPS }, (_, n) => prediction.eye((way * n) / (STEPS - 1)));
    this.cells = regions(this.view(), eyes);
    return this.cells.map(({ bounds }) => bounds);
  }

  offers(outlook: Outlook): { offers: Offer<Part>[]; shown: Use[] } {
    const { near, pitch, farOnly } = this.view();
    const intervals = outlook.eyes.length;
    const uses = new Map<Cell, Use[]>();
    const geometry: [Cell, Use][] = [];
    this.cells.forEach((cell, object) => {
      const away = outlook.eyes.map((eye) => distanceTo(cell.bounds, eye));
      const own = outlook.visible.subarray(object * intervals, (object + 1) * intervals);
      if (!own.some((pixels) => pixels > 0)) return;
      for (let above: Cell | null = cell; above; above = above.parent) {
        if (above.views.size === 0) continue;
        const apart = outlook.focal * pitch * 2 ** above.level;
        const use = { object, accuracy: away.map((metres) => pictureAccuracy(apart / Math.max(metres, 1e-9))) };
        uses.set(above, [...(uses.get(above) ?? []), use]);
      }
      if (!farOnly && cell.geometry && away.some((metres) => metres < near)) {
        geometry.push([cell, { object, accuracy: away.map((metres) => (metres < near ? 1 : 0)) }]);
      }
    });
    const found: { offers: Offer<Part>[]; shown: Use[] } = { offers: [], shown: [] };
    for (const [cell, shows] of uses) this.add(found, cell, false, this.tiles(cell, outlook.eyes[0]!), shows);
    for (const [cell, shows] of geometry) this.add(found, cell, true, [cell.geometry!.leaf, ...cell.geometry!.meshes], [shows]);
    return found;
  }

  /** Offers what is not complete, unless a part of it cannot be had; of what is complete takes note. */
  private add(
    { offers, shown }: { offers: Offer<Part>[]; shown: Use[] }, cell: Cell, isGeometry: boolean, parts: readonly Resource[], uses: readonly Use[],
  ): void {
    if (parts.some(this.view().lacks)) return;
    const resources = parts.filter(({ state }) => state === "absent");
    if (resources.length === 0) shown.push(...uses);
    else offers.push({ item: { cell, isGeometry, resources }, size: resources.reduce((sum, { bytes }) => sum + bytes, 0), uses });
  }

  private tiles(cell: Cell, eye: Vector3): readonly Resource[] {
    const { directions, choice } = this.view();
    return tilesWanted(cell, directions, eye, choice);
  }
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
