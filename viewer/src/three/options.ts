import type { Culling } from "../core/culling.js";
import { DEFAULT_LIGHT, DEFAULT_SKY, type Light } from "./light.js";

/** How a world is shown. All may be changed at any time; none makes anything be fetched again that is still held. */
export interface WorldOptions {
  /** Whether pixels of a picture that lie in a plane are drawn as one. */
  readonly patches: boolean;
  /** Samples a side for each pixel, 1 to 4. */
  readonly supersampling: number;
  /** Directions drawn a cell; null: the tiles that the index picks, down to `leastGain`. */
  readonly views: number | null;
  /** Pixels of a view that a kilobyte of a picked tile must add: less is more bytes and a better picture. */
  readonly leastGain: number;
  /** Depth layers drawn a direction: 1 or 2. */
  readonly layers: number;
  /** Resolution bias: 1 takes cells one level coarser than the picture's pixels ask for, -1 one level finer. */
  readonly bias: number;
  /** Metres within which leaves are geometry; null: as far as a leaf's pixels would be wider than the picture's. */
  readonly nearRadius: number | null;
  /** Leave the near geometry out. */
  readonly farOnly: boolean;
  /**
   * Whether cells farther away may be geometry too, where that comes sooner than their pictures and shows more for its bytes; with
   * `benefit` alone.
   */
  readonly farGeometry: boolean;
  readonly light: Light;
  /**
   * CSS colour; "clear": a sky that follows the sun, which then colours its light and the ambient light too; null leaves
   * whatever the scene has behind the world.
   */
  readonly sky: string | null;
  /** Metres that one can see through the haze; null: for ever. */
  readonly haze: number | null;
  /** Whether the sun casts shadows. */
  readonly shadows: boolean;
  /** Bytes that decoded tiles and geometry may take; what is in the picture stays even beyond it. */
  readonly cacheBytes: number;
  /** Seconds of the eye's flight for which the world is fetched ahead; 0: only what is in the picture and round it. */
  readonly ahead: number;
  /** Whether what adds most to the picture for its bytes is fetched first; else what is nearest. */
  readonly benefit: boolean;
  /**
   * Whether a server that offers it decides what to send, as long as cells are drawn from the tiles that the index picks and what adds
   * most comes first.
   */
  readonly sessions: boolean;
  /** What such a server wants to hear before it does; empty: nothing. */
  readonly token: string;
  /** Bytes uploaded to the graphics card a frame, at most one value more. */
  readonly uploadBytes: number;
  /**
   * What is left out of a picture besides tiles outside it: "none"; "frustum", parts of tiles outside it; or "all", also parts that
   * face away or are hidden. The picture is the same.
   */
  readonly culling: Culling;
  /**
   * Milliseconds that a frame may take while the camera moves: as much less is drawn as that needs. 0: frames take as long as they
   * take. At rest everything is drawn.
   */
  readonly frameMs: number;
  /** Seconds in which what is shown goes over into what is drawn, so that nothing pops when cells change; 0: at once. */
  readonly fade: number;
  /** Motion blur: share of the time between two pictures for which a shutter is open, 0 to 1. */
  readonly shutter: number;
}

const PHONE_CACHE = 192 << 20;
const DESKTOP_CACHE = 768 << 20;

export function defaultOptions(): WorldOptions {
  const memory = (globalThis.navigator as { deviceMemory?: number } | undefined)?.deviceMemory ?? 8;
  return {
    patches: true,
    supersampling: 2,
    views: null,
    leastGain: 10,
    layers: 2,
    bias: 0,
    nearRadius: null,
    farOnly: false,
    farGeometry: true,
    light: DEFAULT_LIGHT,
    sky: DEFAULT_SKY,
    haze: null,
    shadows: false,
    cacheBytes: memory < 4 ? PHONE_CACHE : DESKTOP_CACHE,
    ahead: 8,
    benefit: true,
    sessions: true,
    token: "",
    uploadBytes: 4 << 20,
    culling: "all",
    frameMs: 40,
    fade: 0.5,
    shutter: 0,
  };
}

/** Options with changes; parts of `light` may be changed alone. */
export type OptionChanges = Partial<Omit<WorldOptions, "light">> & { readonly light?: Partial<Light> };

export function withChanges(options: WorldOptions, changes: OptionChanges): WorldOptions {
  return { ...options, ...changes, light: { ...options.light, ...changes.light } };
}

/** Whether a server can be told how the world is drawn. */
export function maySession({ sessions, benefit, views, layers, farOnly }: WorldOptions): boolean {
  return sessions && benefit && views === null && layers === 2 && !farOnly;
}
