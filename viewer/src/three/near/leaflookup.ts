import { Data3DTexture, NearestFilter, RedFormat, UnsignedByteType } from "three";
import type { DrawnLeaf } from "./instances.js";

/** Which leaves are drawn as geometry, and at which level, as a box of bytes for the graphics card: 0 = not, else level + 1. */
export class LeafLookup {
  texture = new Data3DTexture(new Uint8Array(1), 1, 1, 1);
  /** Index of the leaf of the first texel. */
  first: readonly [number, number, number] = [0, 0, 0];

  /** Holds exactly these leaves. */
  set(leaves: readonly DrawnLeaf[]): void {
    const along = (axis: "x" | "y" | "z"): { first: number; count: number } => {
      const indices = leaves.map(({ cell }) => cell.key[axis]);
      const first = Math.min(...indices);
      return { first, count: Math.max(...indices) - first + 1 };
    };
    if (leaves.length === 0) return;
    const [x, y, z] = [along("x"), along("y"), along("z")];
    const bytes = new Uint8Array(x.count * y.count * z.count);
    for (const { cell: { key }, level } of leaves) {
      bytes[key.x - x.first + x.count * (key.y - y.first + y.count * (key.z - z.first))] = level + 1;
    }
    this.first = [x.first, y.first, z.first];
    this.texture.dispose();
    this.texture = new Data3DTexture(bytes, x.count, y.count, z.count);
    this.texture.format = RedFormat;
    this.texture.type = UnsignedByteType;
    this.texture.minFilter = this.texture.magFilter = NearestFilter;
    this.texture.unpackAlignment = 1;
    this.texture.needsUpdate = true;
  }

  dispose(): void {
    this.texture.dispose();
  }
}
