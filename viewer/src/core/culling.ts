import type { DepthPyramid } from "./depthpyramid.js";
import { BOX, CONE, type Blocks } from "./orthoview/blocks.js";
import { LatticeView, sameProjection, type Lattice, type Projection } from "./projection.js";
import { Ranges } from "./ranges.js";
import type { Box } from "./vector.js";

/** A layer of an orthoview whose blocks are drawn or left out. */
export interface CullableTile {
  readonly lattice: Lattice;
  readonly blocks: Blocks;
  /** (6,) lower and upper corner of all blocks, as theirs. */
  readonly extent: Float32Array;
}

/** What is left out: nothing but tiles outside the picture, blocks outside the picture, or also what is hidden or faces away. */
export type Culling = "none" | "frustum" | "all";

/** Pitches within which footprints are too large to be told from their boxes: drawn, hidden or not. */
const CLOSE = 64;
/** Pixels that a footprint reaches beyond its box in the picture: the pixel that holds its middle, and the bend of perspective. */
const FOOTPRINT = 2;
/** The world's own frame as a lattice of metres. */
const WORLD: Lattice = { axes: { u: [1, 0, 0], v: [0, 1, 0], w: [0, 0, 1] }, corner: [0, 0, 0], pitch: 1 };

/** A box at `boxes[at]`, along a lattice, that may be hidden; but not from within so many pitches. */
interface Hideable {
  readonly lattice: Lattice;
  readonly boxes: Float32Array;
  readonly at: number;
  readonly close: number;
}

/** Decides, for one picture, which blocks of its tiles and which other boxes are drawn. */
export class Culler {
  readonly ranges = new Ranges();
  /** Splats of the blocks within the picture, hidden or not. */
  inFrustum = 0;
  /** Pixels around a block that have to be hidden as well: from elsewhere things shift against each other. */
  private readonly slack: number;
  private readonly hidden: Hideable[] = [];
  private readonly world: LatticeView;
  private readonly worldBefore: LatticeView | null;

  /** view: of the picture. before: how far one saw in a picture drawn before, from the same place or another; null: not known. */
  constructor(
    readonly view: Projection,
    private readonly culling: Culling,
    private readonly before: DepthPyramid | null,
  ) {
    this.slack = !before || sameProjection(before.view, view) ? 0 : before.texel;
    this.world = new LatticeView(view, WORLD);
    this.worldBefore = this.viewBefore(WORLD);
  }

  /** Splats drawn. */
  get drawn(): number {
    return this.ranges.pixels;
  }

  /** Whether anything was left out as hidden, which a picture from before cannot tell for certain. */
  get isGuess(): boolean {
    return this.hidden.length > 0;
  }

  /** Adds a tile's blocks to the ranges; returns whether there is any to be drawn. */
  add(tile: CullableTile): boolean {
    const { blocks, extent, lattice } = tile;
    const seen = new LatticeView(this.view, lattice);
    if (!seen.sees(extent, 0)) return false;
    this.ranges.begin();
    const before = this.viewBefore(lattice);
    const behind = before && this.isHidden(before, { lattice, boxes: extent, at: 0, close: CLOSE });
    for (let n = 0; n < blocks.count; n++) {
      if (this.culling !== "none" && !seen.sees(blocks.boxes, n * BOX)) continue;
      const [start, end] = [blocks.starts[n]!, blocks.starts[n + 1]!];
      this.inFrustum += end - start;
      if (behind || (this.culling === "all" && facesAway(seen, blocks, n))) continue;
      if (before && this.isHidden(before, { lattice, boxes: blocks.boxes, at: n * BOX, close: CLOSE })) continue;
      this.ranges.add(start, end);
    }
    return this.ranges.length > 0;
  }

  /** Whether what is in a box, local metres, is to be drawn. */
  addBox({ lower, upper }: Box): boolean {
    const box = { lattice: WORLD, boxes: Float32Array.of(...lower, ...upper), at: 0, close: 0 };
    return this.world.sees(box.boxes, 0) && !(this.worldBefore && this.isHidden(this.worldBefore, box));
  }

  /** Whether all that was left out as hidden is hidden in the picture that was drawn: then that is the picture of everything. */
  isRight(drawn: DepthPyramid): boolean {
    return this.hidden.every((box) => isBehind(new LatticeView(drawn.view, box.lattice), box, drawn, 0));
  }

  private viewBefore(lattice: Lattice): LatticeView | null {
    return this.culling === "all" && this.before ? new LatticeView(this.before.view, lattice) : null;
  }

  /** Whether a box was hidden in the picture before; then that is noted. */
  private isHidden(view: LatticeView, box: Hideable): boolean {
    const hidden = isBehind(view, box, this.before!, this.slack);
    if (hidden) this.hidden.push(box);
    return hidden;
  }
}

/** Whether a block shows nothing but backs. */
function facesAway({ eye }: LatticeView, { boxes, cones }: Blocks, n: number): boolean {
  const [box, cone] = [n * BOX, n * CONE];
  let [square, radius, facing] = [0, 0, 0];
  for (let a = 0; a < 3; a++) {
    const [lower, upper] = [boxes[box + a]!, boxes[box + a + 3]!];
    const to = (lower + upper) / 2 - eye[a]!;
    square += to * to;
    radius += ((upper - lower) / 2) ** 2;
    facing += to * cones[cone + a]!;
  }
  const beside = Math.sqrt(Math.max(0, square - facing * facing));
  return facing * cones[cone + 3]! - beside * cones[cone + 4]! > Math.sqrt(radius) + 1e-4 * Math.sqrt(square);
}

/**
 * Whether a box lies behind what a picture shows. slack: pixels around it that have to be nearer as well; 0 when the picture is the
 * one that is asked about, and what is beside it does not matter.
 */
function isBehind({ view, eye, toX, toY, toW }: LatticeView, { boxes, at, close }: Hideable, picture: DepthPyramid, slack: number): boolean {
  let [left, right, bottom, top, nearest] = [Infinity, -Infinity, Infinity, -Infinity, Infinity];
  for (let corner = 0; corner < 8; corner++) {
    const u = boxes[at + (corner & 1 ? 3 : 0)]! - eye[0];
    const v = boxes[at + 1 + (corner & 2 ? 3 : 0)]! - eye[1];
    const w = boxes[at + 2 + (corner & 4 ? 3 : 0)]! - eye[2];
    const d = toW[0] * u + toW[1] * v + toW[2] * w;
    if (d <= view.near) return false;
    const x = (toX[0] * u + toX[1] * v + toX[2] * w) / d;
    const y = (toY[0] * u + toY[1] * v + toY[2] * w) / d;
    if (x < left) left = x;
    if (x > right) right = x;
    if (y < bottom) bottom = y;
    if (y > top) top = y;
    if (d < nearest) nearest = d;
  }
  const pitch = Math.sqrt(toW[0] * toW[0] + toW[1] * toW[1] + toW[2] * toW[2]);
  if (nearest < close * pitch) return false;
  const reach = FOOTPRINT + slack;
  if (slack > 0 && (left < reach || bottom < reach || right > view.width - reach || top > view.height - reach)) return false;
  return picture.closes(left - reach, bottom - reach, right + reach, top + reach, nearest);
}
