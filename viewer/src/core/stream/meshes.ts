import type { Cell } from "../cell.js";
import { errorAt } from "../cellforms.js";
import { sightOf, squareness, type Board, type ImpostorForm, type Sight } from "../impostors.js";
import { MESH_FARTHEST } from "../indextile.js";
import type { Instance, MeshForm, PlacedMesh } from "../instances.js";
import type { Resource } from "../resource.js";
import type { Box } from "../vector.js";
import type { Use } from "./offers.js";
import type { Outlook } from "./outlook.js";

/** How much of the accuracy of a mesh's level is that of the thesis, by the size of its faces, or of an image's, by its pixels. */
const FINE = 0.5;
const NO_IMAGES: ReadonlyMap<string, number> = new Map();

/** Where an object will be seen from. */
export interface Seen {
  /** Metres to it in each interval. */
  readonly away: readonly number[];
  /** Metres that a pixel is wide there. */
  readonly widths: readonly number[];
}

/** An instance that will be seen. */
export interface PlacedRow {
  readonly of: PlacedMesh;
  readonly instance: Instance;
  readonly seen: Seen;
  /** In which intervals the leaf that it lies in is near. */
  readonly near: readonly boolean[];
  /** The finest level that may be drawn from farther. */
  readonly from: number;
  readonly object: number;
  readonly cell: Cell;
  /** Square metres of the rectangle round it as it is seen from a side, at most. */
  readonly side: number;
  /** How much of it is seen, all intervals together. */
  readonly pixels: number;
}

/** A form of a mesh or an image of it, and the instances that it shows. */
export interface MeshPart {
  /** That in which most of it is seen. */
  readonly cell: Cell;
  /** Hash of the full mesh. */
  readonly mesh: string;
  readonly resources: readonly Resource[];
  /** Hash and bytes of each image that it needs besides. */
  readonly images: ReadonlyMap<string, number>;
  readonly uses: readonly Use[];
}

/** How each of several instances will be seen in each interval. */
type Sights = readonly (readonly Sight[])[];

/** Levels and images of meshes whose instances will be seen: sent once, placed many times. */
export class MeshParts {
  constructor(
    private readonly outlook: Outlook,
    /** Metres between the pixels of a leaf's pictures. */
    private readonly pitch: number,
    private readonly farGeometry: boolean,
  ) {}

  /** Levels of the mesh of instances that will be seen: sent once, placed many times. */
  levelsOf(forms: readonly MeshForm[], rows: readonly PlacedRow[]): MeshPart[] {
    const { pitch } = this;
    return forms.map((form) => {
      const uses = rows.map(({ seen, near, from, object, side }) => {
        const isFar = from < Infinity && form.level >= Math.min(from, forms.length - 1);
        const fine = (width: number): number => fineness(side / width ** 2, form, forms[0]!);
        const looks = (width: number): number => (1 - FINE) * (1 - errorAt(form, pitch, width, MESH_FARTHEST)) + FINE * fine(width);
        return { object, accuracy: seen.widths.map((width, k) => (near[k] || isFar ? looks(width) : 0)) };
      });
      return meshPart(rows, form.mesh, form.images, uses);
    });
  }

  /** Images of instances that will be seen, from the sides that they will be seen from, and those that are there or on their way. */
  boardsOf(rows: readonly PlacedRow[]): MeshPart[] {
    const { outlook } = this;
    const { impostors } = rows[0]!.of;
    if (impostors.length === 0) return [];
    const sights = rows.map(({ of, instance }) => outlook.eyes.map((eye) => sightOf(of, instance, eye)));
    return impostors.flatMap((impostor) => {
      const sides = sidesFrom(impostor, rows, sights, outlook);
      impostor.boards.forEach(({ mesh: { state } }, side) => state !== "absent" && sides.add(side));
      const shown = rows.map((row) => this.likeness(impostor, row));
      return [...sides].sort((a, b) => a - b).map((side) => boardPart(impostor.boards[side]!, rows, shown, sights));
    });
  }

  /** How well an impostor shows an instance in each interval, seen head on: half by its images' pixels, half by what was measured. */
  private likeness({ told, entry }: ImpostorForm, { seen, near, object }: PlacedRow): number[] {
    const { widths } = seen;
    const { farGeometry, outlook: { height } } = this;
    return widths.map((width, k) => {
      if (!near[k] && !farGeometry) return 0;
      const sharp = Math.min(entry.rows / Math.max(height[object * widths.length + k]!, 1e-9), 1);
      return (1 - FINE) * (1 - errorAt({ told }, this.pitch, width, MESH_FARTHEST)) + FINE * sharp;
    });
  }
}

/** As the thesis has it, of a form that takes `area` pixels (BEN 4.1); the twin of `level_accuracy`. */
function fineness(area: number, form: MeshForm, full: MeshForm): number {
  return Math.sqrt(Math.max(area / full.entry.triangles, 1) / Math.max(area / form.entry.triangles, 1));
}

function meshPart(rows: readonly PlacedRow[], mesh: Resource, images: MeshPart["images"], uses: readonly Use[]): MeshPart {
  const { cell, of } = rows.reduce((most, row) => (row.pixels > most.pixels ? row : most));
  return { cell, mesh: of.forms[0]!.entry.hash, resources: [mesh], images, uses };
}

/** An image, of instances that it would show so well head on, and which are seen so in each interval. */
function boardPart(board: Board, rows: readonly PlacedRow[], shown: readonly (readonly number[])[], sights: Sights): MeshPart {
  const uses = rows.map(({ object }, n) => ({ object, accuracy: shown[n]!.map((like, k) => like * squareness(board, sights[n]![k]!)) }));
  return meshPart(rows, board.mesh, NO_IMAGES, uses);
}

/** Numbers of the baked boards that are the nearest to any line of sight. */
function sidesFrom({ entry }: ImpostorForm, rows: readonly PlacedRow[], sights: Sights, { visible, eyes }: Outlook): Set<number> {
  const { length } = entry.images;
  const step = (2 * Math.PI) / length;
  const found = new Set<number>();
  rows.forEach(({ object }, n) => {
    sights[n]!.forEach(([x, y], k) => {
      if (visible[object * eyes.length + k]! > 0) found.add((Math.round(Math.atan2(y, x) / step) + length) % length);
    });
  });
  return found;
}

/** Square metres of the rectangle round a box as it is seen from a side, at most. */
export function sideOf({ lower, upper }: Box): number {
  return Math.hypot(upper[0] - lower[0], upper[1] - lower[1]) * (upper[2] - lower[2]);
}
