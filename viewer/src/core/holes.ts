/**
 * The parts of a cell for which it stands in: all of it (HOLE), nothing (COVERED), or a mixture by child, one entry an
 * octant (Grid.octant).
 */
export type Holes = typeof HOLE | typeof COVERED | readonly Holes[];

export const COVERED = 0;
export const HOLE = 1;
const OCTANTS = 8;

/** Joins the holes of a cell's children, given as (octant, holes); octants without a child hold nothing to cover. */
export function joinHoles(children: readonly (readonly [number, Holes])[]): Holes {
  if (children.every(([, holes]) => holes === COVERED)) return COVERED;
  if (children.every(([, holes]) => holes === HOLE)) return HOLE;
  const joined: Holes[] = new Array<Holes>(OCTANTS).fill(COVERED);
  for (const [octant, holes] of children) joined[octant] = holes;
  return joined;
}

/** A cell as far as it is known what lies below. */
interface Holding {
  readonly octant: number;
  readonly children: readonly Holding[] | null;
}

/** To what lies beside an octant: above or below it, then along one of the other axes, then across. */
const FLIPS = [4, 2, 1, 6, 5, 3, 7];

/**
 * The same, with octants that hold nothing as what is beside them, mirrored: surfaces that are simplified lie a little beside what they
 * show, and would have gaps there.
 */
export function spread(holes: Holes, { children }: Holding): Holes {
  if (typeof holes === "number") return holes;
  const known = new Map((children ?? []).map((child) => [child.octant, spread(holes[child.octant]!, child)]));
  return holes.map((part, octant) => {
    const flip = [0, ...FLIPS].find((bits) => known.has(octant ^ bits));
    return flip === undefined ? part : mirrored(known.get(octant ^ flip)!, flip);
  });
}

function mirrored(holes: Holes, flip: number): Holes {
  return typeof holes === "number" || flip === 0 ? holes : holes.map((_, octant) => mirrored(holes[octant ^ flip]!, flip));
}

/**
 * Holes of several cells as one table for the graphics card: nodes of 8 words, one an octant, each COVERED, HOLE or the
 * place of the node of that octant.
 */
export class HoleTable {
  /** The words written so far; place 0 and 1 are never nodes. */
  readonly words: number[] = new Array<number>(OCTANTS).fill(0);

  /** Adds the holes of a cell; returns the place of its node, or HOLE when all of it is one. */
  add(holes: Holes): number {
    if (typeof holes === "number") return holes;
    const place = this.words.length;
    this.words.push(...new Array<number>(OCTANTS).fill(0));
    holes.forEach((part, octant) => {
      this.words[place + octant] = this.add(part);
    });
    return place;
  }
}
