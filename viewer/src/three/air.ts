import { Matrix3, Vector3 } from "three";
import { CLEAR_SKY, DEFAULT_SKY, linear, sunDirection } from "./light.js";
import type { WorldOptions } from "./options.js";
import { clearSky } from "./sky.js";
import type { Viewpoint } from "./viewpoint.js";

/** What is as far away as one can see keeps a fiftieth of its contrast (Koschmieder). */
const SEEN_CONTRAST = -Math.log(0.02);

/** Uniforms of the sky and the haze, and of the rays along which they are seen. */
export class Air {
  readonly uniforms = {
    skyKind: { value: 0 },
    sky: { value: new Vector3() },
    haze: { value: 0 },
    sunWay: { value: new Vector3() },
    zenith: { value: new Vector3() },
    towards: { value: new Vector3() },
    away: { value: new Vector3() },
    sunlight: { value: new Vector3() },
    toRay: { value: new Matrix3() },
    texel: { value: 1 },
  };

  set({ sky, haze, light }: WorldOptions): void {
    const { uniforms } = this;
    uniforms.skyKind.value = sky === null ? 0 : sky === CLEAR_SKY ? 2 : 1;
    uniforms.haze.value = haze === null ? 0 : SEEN_CONTRAST / haze;
    // Haze before a scene's own background has the usual sky's colour.
    if (sky !== CLEAR_SKY) uniforms.sky.value.copy(linear(sky ?? DEFAULT_SKY));
    const sun = sunDirection(light);
    const { zenith, towards, away, sunlight } = clearSky(sun);
    uniforms.sunWay.value.set(...sun);
    uniforms.zenith.value.set(...zenith);
    uniforms.towards.value.set(...towards);
    uniforms.away.value.set(...away);
    uniforms.sunlight.value.set(...sunlight);
  }

  /** Takes a viewpoint; samples: of its frame along a side of a pixel of the picture. */
  see({ toX, toY, toW, focal }: Viewpoint, samples: number): void {
    this.uniforms.toRay.value.set(...toX, ...toY, ...toW).invert();
    this.uniforms.texel.value = samples / focal;
  }
}
