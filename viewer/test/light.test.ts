import { describe, expect, it } from "vitest";
import { CLEAR_SKY, DEFAULT_LIGHT, LightUniforms, sunDirection } from "../src/three/light.js";
import { radiiOf } from "../src/three/shadows.js";
import { clearSky } from "../src/three/sky.js";

const at = (elevation: number) => clearSky(sunDirection({ ...DEFAULT_LIGHT, elevation }));
const sum = (c: readonly number[]): number => c.reduce((a, b) => a + b);

describe("a clear sky", () => {
  it("dims and reddens the sun as it sets, and leaves some light at night", () => {
    const [high, low, night] = [at(60), at(3), at(-10)];
    expect(high.sunlight[2]).toBeGreaterThan(0.95);
    expect(low.sunlight[0]).toBeGreaterThan(2 * low.sunlight[2]);
    expect(sum(night.sunlight)).toBe(0);
    expect(sum(high.ambient)).toBeGreaterThan(sum(low.ambient));
    expect(sum(night.ambient)).toBeGreaterThan(0.3);
  });

  it("colours the light only where it is asked for", () => {
    const light = new LightUniforms();
    light.set(DEFAULT_LIGHT, "white");
    expect(light.sunLight.value.toArray()).toEqual([1, 1, 1]);
    light.set(DEFAULT_LIGHT, CLEAR_SKY);
    const { r, g, b } = { r: light.sunLight.value.x, g: light.sunLight.value.y, b: light.sunLight.value.z };
    expect(r).toBeGreaterThan(g);
    expect(g).toBeGreaterThan(b);
  });
});

describe("the spheres of shadow maps", () => {
  it.each([[0, 40], [2, 500], [60, 20_000], [900, 1_000], [30_000, 30_100]])("reach from %d m to %d m", (nearest, farthest) => {
    const radii = radiiOf(nearest, farthest);
    expect(radii.length).toBeLessThanOrEqual(4);
    expect(radii.at(-1)).toBeGreaterThanOrEqual(farthest);
    for (let n = 1; n < radii.length; n++) {
      expect(radii[n]! / radii[n - 1]!).toBeGreaterThan(1);
      expect(radii[n]! / radii[n - 1]!).toBeLessThanOrEqual(8);
    }
  });

  it("keep their sizes while the eye moves a little", () => {
    expect(radiiOf(50, 1_000)).toEqual(radiiOf(51, 1_010));
  });
});
