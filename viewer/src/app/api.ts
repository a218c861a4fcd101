import type { Vector3 } from "../core/vector.js";
import type { OptionChanges } from "../three/options.js";
import type { Picked } from "../three/picker.js";
import type { WorldStats } from "../three/stats.js";
import type { FarfieldWorld } from "../three/world.js";
import type { Application } from "./application.js";

/** Figures of the page: the world's, and of its frames. */
export interface PageStats extends WorldStats {
  /** Milliseconds from the start of the last frame until the graphics card was done with it. */
  readonly frame_ms: number;
  /** Frames drawn so far. */
  readonly frames: number;
  /** Milliseconds from navigation to the first complete picture; null before it. */
  readonly first_picture_ms: number | null;
}

/** What tests and pages that embed this one may use: `window.farfield`. */
export interface FarfieldPage {
  /** Fulfilled when everything that the current view wants is fetched and drawn. */
  whenComplete(): Promise<void>;
  /** `fov` is vertical, degrees; positions are local metres. */
  setCamera(camera: { readonly eye: Vector3; readonly target: Vector3; readonly fov?: number }): void;
  getCamera(): { readonly eye: Vector3; readonly target: Vector3; readonly fov: number };
  setOptions(changes: OptionChanges): void;
  stats(): PageStats;
  hideInterface(): void;
  /** What is at a place of the picture, CSS pixels from its upper left corner; null: nothing. Nothing is shown of it. */
  pick(x: number, y: number): Promise<Picked | null>;
  readonly world: FarfieldWorld;
}

export function pageOf(application: Application): FarfieldPage {
  return {
    whenComplete: () => application.world.whenComplete(),
    setCamera: ({ eye, target, fov }) => application.setPose({ eye, target, fov: fov ?? application.pose.fov }),
    getCamera: () => application.pose,
    setOptions: (changes) => application.setOptions(changes),
    stats: () => application.stats,
    hideInterface: () => application.hideInterface(),
    pick: (x, y) => application.pick(x, y),
    world: application.world,
  };
}

declare global {
  interface Window {
    farfield?: FarfieldPage;
  }
}
