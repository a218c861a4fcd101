import { Matrix3, Vector2, Vector3, type Group } from "three";
import type { DecodedBlockMap } from "../core/blockmap/decode.js";
import type { Cell } from "../core/cell.js";
import type { Culler } from "../core/culling.js";
import type { Grid } from "../core/grid.js";
import { HOLE, type Holes } from "../core/holes.js";
import { cross, distanceTo, dot, type Box, type Vector3 as Triple } from "../core/vector.js";
import { BlockMapBoxes } from "./blockmapboxes.js";
import { BlockMapPage, layerBytes } from "./blockmappage.js";
import { HoleTexture, holeUniforms, setHoles } from "./holetexture.js";
import type { LightUniforms } from "./light.js";
import type { Viewpoint } from "./viewpoint.js";

/** Parts of a texel's width that a box reaches beyond the lowest and the highest point, as in shaders/blockmap.glsl. */
const MARGIN = 64;

/** A BlockMap on the graphics card. */
export interface BlockMapHandle {
  /** Of the graphics card, and as many here. */
  readonly bytes: number;
}

/** A BlockMap to be drawn, for the parts of its cell that nothing finer covers. */
export interface BlockMapDraw {
  readonly cell: Pick<Cell, "box" | "level">;
  readonly handle: BlockMapHandle;
  readonly holes: Holes;
  /** Whether parts of finer cells are drawn before it, which show the same. */
  readonly behind: boolean;
}

/** What a picture of BlockMaps depends on besides these. */
export interface BlockMapView {
  readonly viewpoint: Viewpoint;
  readonly sun: Triple;
  /** Decides what is drawn. */
  readonly culler: Culler;
}

/** What stays of a map when its texels are in a page. */
interface Held extends BlockMapHandle {
  readonly page: BlockMapPage;
  readonly layer: number;
  readonly map: Pick<DecodedBlockMap, "n" | "low" | "step" | "across" | "byArea" | "thresholds" | "highest"> & { readonly sloped: boolean; readonly floored: boolean };
}

/** Draws BlockMaps by casting rays (spec/drawing.md, BlockMaps): those that are drawn whole in one call a page, others in one each. */
export class BlockMaps {
  /** Maps drawn last, and draw calls for them. */
  readonly stats = { maps: 0, calls: 0 };
  /** Of whole maps, by page. */
  private readonly pages = new Map<BlockMapPage, BlockMapBoxes>();
  private readonly partial: { readonly boxes: BlockMapBoxes; readonly holes: ReturnType<typeof holeUniforms> }[] = [];
  private readonly holes: HoleTexture;
  private readonly shared;

  constructor(
    private readonly group: Group,
    private readonly grid: Grid,
    light: LightUniforms,
  ) {
    this.holes = new HoleTexture(grid);
    this.shared = {
      ...light,
      toX: { value: new Vector3() },
      toY: { value: new Vector3() },
      toW: { value: new Vector3() },
      toRay: { value: new Matrix3() },
      sun: { value: new Vector3() },
      frame: { value: new Vector2() },
      near: { value: 1 },
    };
  }

  /** Takes a map to the graphics card, with the next picture. */
  upload(decoded: DecodedBlockMap): BlockMapHandle {
    const { n, m, low, step, across, byArea, thresholds, highest, slopes, floors } = decoded;
    const page = this.pageFor(n, m);
    const layer = page.put(decoded);
    const held: Held = { bytes: page.layerBytes, page, layer, map: { n, low, step, across, byArea, thresholds, highest, sloped: slopes !== null, floored: floors !== null } };
    return held;
  }

  /** What a map will take of the graphics card, and as many here. */
  bytesOf({ n, m }: DecodedBlockMap): number {
    return layerBytes(n, m);
  }

  /** Forgets a map; it must not be among what is drawn next. */
  drop(handle: BlockMapHandle): void {
    const { page, layer } = handle as Held;
    page.drop(layer);
    if (!page.isEmpty) return;
    this.pages.get(page)!.dispose();
    page.dispose();
    this.pages.delete(page);
  }

  /** Takes what is to be drawn; what is certain not to be seen is left out, and the nearest come first. */
  set(draws: readonly BlockMapDraw[], { viewpoint, sun, culler }: BlockMapView): void {
    this.setView(viewpoint, sun);
    this.holes.clear();
    for (const boxes of this.pages.values()) boxes.clear();
    for (const { boxes } of this.partial) boxes.clear();
    const { eye } = viewpoint;
    const seen = draws.map((draw) => ({ draw, box: boxOf(draw) })).filter(({ box }) => culler.addBox(box));
    const sorted = seen.map(({ draw, box }) => ({ draw, away: distanceTo(box, eye) })).sort((a, b) => a.away - b.away);
    let parts = 0;
    for (const { draw } of sorted) {
      if (draw.holes === HOLE) this.place(this.pages.get((draw.handle as Held).page)!, draw, eye);
      else this.placePart(parts++, draw, eye);
    }
    this.holes.upload();
    this.stats.maps = sorted.length;
    this.stats.calls = parts + [...this.pages.values()].filter(({ count }) => count > 0).length;
  }

  dispose(): void {
    for (const [page, boxes] of this.pages) {
      boxes.dispose();
      page.dispose();
    }
    this.pages.clear();
    for (const { boxes } of this.partial.splice(0)) boxes.dispose();
    this.holes.dispose();
  }

  private pageFor(n: number, m: number): BlockMapPage {
    for (const page of this.pages.keys()) if (page.n === n && page.m === m && !page.isFull) return page;
    const page = new BlockMapPage(n, m);
    this.pages.set(page, this.makeBoxes(page.capacity, null));
    return page;
  }

  private makeBoxes(capacity: number, own: ReturnType<typeof holeUniforms> | null): BlockMapBoxes {
    const boxes = new BlockMapBoxes(capacity, this.shared, own && { ...this.holes.uniforms, ...own });
    this.group.add(boxes.mesh);
    return boxes;
  }

  private placePart(number: number, draw: BlockMapDraw, eye: Triple): void {
    const own = holeUniforms();
    const part = (this.partial[number] ??= { holes: own, boxes: this.makeBoxes(1, own) });
    setHoles(part.holes, draw.cell as Cell, this.holes.add(draw.holes), eye);
    this.place(part.boxes, draw, eye);
  }

  private place(boxes: BlockMapBoxes, { cell, handle, behind }: BlockMapDraw, eye: Triple): void {
    const { page, layer, map } = handle as Held;
    const { lower, upper } = cell.box;
    const [x, y, z] = [lower[0] - eye[0], lower[1] - eye[1], lower[2] + map.low - eye[2]];
    const [width, depth] = [(upper[0] - lower[0]) / map.n, (upper[1] - lower[1]) / map.n];
    boxes.add(page, [
      x, y, z, layer,
      width, depth, map.step, map.highest - map.low,
      ...map.thresholds.map((height) => height - map.low), behind ? this.grid.pitch(cell.level) : 0,
      map.across, Number(map.byArea), Number(map.sloped), Number(map.floored),
    ]);
  }

  private setView({ toX, toY, toW, width, height, near }: Viewpoint, sun: Triple): void {
    const { shared } = this;
    shared.toX.value.set(...toX);
    shared.toY.value.set(...toY);
    shared.toW.value.set(...toW);
    shared.sun.value.set(...sun);
    shared.frame.value.set(width, height);
    shared.near.value = near;
    const [a, b, c] = [cross(toY, toW), cross(toW, toX), cross(toX, toY)];
    const volume = dot(toX, a);
    shared.toRay.value.set(a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]).multiplyScalar(1 / volume);
  }
}

/** What of a cell a map may be seen in. */
function boxOf({ cell: { box }, handle }: BlockMapDraw): Box {
  const { n, low, highest } = (handle as Held).map;
  const [x, y, z] = box.lower;
  const margin = (box.upper[0] - x) / n / MARGIN;
  return { lower: [x, y, z + low - margin], upper: [box.upper[0], box.upper[1], z + highest + margin] };
}
