import type { BufferGeometry, Texture } from "three";

/** A surface of one material. */
export interface NearPart {
  readonly geometry: BufferGeometry;
  readonly surface: NearSurface;
  readonly triangles: number;
}

/** How a part looks before any light falls on it. */
export interface NearSurface {
  readonly map: Texture | null;
  /** Linear light and alpha. */
  readonly factor: readonly [number, number, number, number];
  /** Alpha below this is a hole. */
  readonly cutoff: number;
  readonly unlit: boolean;
  readonly colored: boolean;
}

/** Placements of one shared mesh in a leaf. */
export interface Placements {
  readonly mesh: string;
  /** (16, n) columns first, from the mesh's frame to the leaf's. */
  readonly transforms: Float32Array;
  /** (n,) object ids. */
  readonly objects: Uint32Array;
}

/** A GLB of the world: a leaf, or a mesh that instances share (then without placements). */
export interface NearModel {
  readonly parts: readonly NearPart[];
  readonly placements: readonly Placements[];
  /** Bytes it takes on the graphics card, textures that others had before apart. */
  readonly bytes: number;
  dispose(): void;
}
