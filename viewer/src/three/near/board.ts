import { BufferAttribute, BufferGeometry, ClampToEdgeWrapping, type Texture } from "three";
import type { NearModel } from "./model.js";
import { sampled, textureBytes } from "./textures.js";

/** Alpha below which a board has a hole. */
const CUTOFF = 0.5;
/** How far normals lean outwards at a board's corners, for 1 towards the eye: those of a body as deep as the board is wide. */
const BULGE = 1.2;
const CORNERS = [[0.5, -0.5], [-0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]] as const;

/** A board in its own frame (core/impostors.ts), two triangles with an image of a mesh; the texture is freed with it. */
export function boardModel(image: Texture, anisotropy: number): NearModel {
  const map = sampled(image, ClampToEdgeWrapping, anisotropy);
  const geometry = new BufferGeometry();
  const set = (name: string, size: number, of: (x: number, z: number) => readonly number[]): void => {
    geometry.setAttribute(name, new BufferAttribute(Float32Array.from(CORNERS.flatMap(([x, z]) => of(x, z))), size));
  };
  set("position", 3, (x, z) => [x, 0, z]);
  // All of one length, so that what lies between them is what lies between those that are not normalised.
  set("normal", 3, (x, z) => [BULGE * x, 1, BULGE * z].map((part) => part / Math.hypot(BULGE * x, 1, BULGE * z)));
  set("uv", 2, (x, z) => [x + 0.5, 0.5 - z]);
  geometry.setIndex([0, 1, 2, 0, 2, 3]);
  const surface = { map, factor: [1, 1, 1, 1], cutoff: CUTOFF, unlit: false, colored: false } as const;
  const dispose = (): void => {
    geometry.dispose();
    map.dispose();
  };
  return { parts: [{ geometry, surface, triangles: 2, features: 0 }], placements: [], objects: null, bytes: textureBytes(map) + bytesOf(geometry), dispose };
}

function bytesOf({ attributes, index }: BufferGeometry): number {
  return [...Object.values(attributes), index!].reduce((sum, { array }) => sum + array.byteLength, 0);
}
