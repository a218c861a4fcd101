import { Color, Vector3 } from "three";
import type { Vector3 as Triple } from "../core/vector.js";
import { clearSky } from "./sky.js";

/** Light on the world (spec/drawing.md, Light). Colours are sRGB, as CSS writes them. */
export interface Light {
  /** Of the sun, degrees from north, clockwise. */
  readonly azimuth: number;
  /** Of the sun, degrees above the horizon. */
  readonly elevation: number;
  readonly strength: number;
  readonly sunColor: string;
  readonly ambient: number;
  readonly ambientColor: string;
}

export const DEFAULT_LIGHT: Light = {
  azimuth: 225,
  elevation: 35,
  strength: 1,
  sunColor: "#ffffff",
  ambient: 0.3,
  ambientColor: "#ffffff",
};

export const DEFAULT_SKY = "rgb(158, 191, 235)";

/** The sky that follows the sun. */
export const CLEAR_SKY = "clear";

/** Unit vector towards the sun, in the world's own frame. */
export function sunDirection({ azimuth, elevation }: Light): Triple {
  const [a, e] = [(azimuth * Math.PI) / 180, (elevation * Math.PI) / 180];
  return [Math.sin(a) * Math.cos(e), Math.cos(a) * Math.cos(e), Math.sin(e)];
}

/** Uniforms shared by everything that is lit. */
export class LightUniforms {
  readonly ambientLight = { value: new Vector3() };
  readonly sunLight = { value: new Vector3() };

  set(light: Light, sky: string | null): void {
    this.ambientLight.value.copy(linear(light.ambientColor).multiplyScalar(light.ambient));
    this.sunLight.value.copy(linear(light.sunColor).multiplyScalar(light.strength));
    if (sky !== CLEAR_SKY) return;
    const { ambient, sunlight } = clearSky(sunDirection(light));
    this.ambientLight.value.multiply(new Vector3(...ambient));
    this.sunLight.value.multiply(new Vector3(...sunlight));
  }
}

/** A CSS colour in linear light. */
export function linear(css: string): Vector3 {
  const { r, g, b } = new Color(css);
  return new Vector3(r, g, b);
}
