import type { BufferGeometry, Texture } from "three";

/** (triangles,) number of the feature that each triangle is of, in as few bytes as it takes; a number: that of all. Not for the graphics card. */
export type Features = Uint8Array | Uint16Array | Uint32Array | number;

/** A surface of one material. */
export interface NearPart {
  readonly geometry: BufferGeometry;
  readonly surface: NearSurface;
  readonly triangles: number;
  readonly features: Features;
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
  /** (features,) object ids; null: the number of a feature is its id or, of a mesh that instances share, counted from theirs. */
  readonly objects: Uint32Array | null;
  /** Bytes it takes, most of them on the graphics card, textures that others had before apart. */
  readonly bytes: number;
  dispose(): void;
}
