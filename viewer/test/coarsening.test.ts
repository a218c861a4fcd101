import { expect, it } from "vitest";
import { Resource } from "../src/core/resource.js";
import { Sizes } from "../src/core/sizes.js";
import { CoarseningControl } from "../src/three/coarsening.js";

const tiles = (count: number): Resource[] =>
  Array.from({ length: count }, (_, n) => new Resource(`orthoview/${n}`, "orthoview", 1000, null));

it("gets coarser before what is wanted is fetched, and finer again when there is room", () => {
  const control = new CoarseningControl(new Sizes());
  // A tile of 1000 bytes is expected to take 13000.
  expect(control.adapt(tiles(10), 150_000)).toBe("same");
  expect(control.adapt(tiles(20), 150_000)).toBe("coarser");
  expect(control.adapt(tiles(10), 150_000)).toBe("same");
  expect(control.adapt(tiles(2), 150_000)).toBe("finer");
  expect(control.levels).toBe(0);
});

it("learns how large tiles become, and stops at some point", () => {
  const sizes = new Sizes();
  const control = new CoarseningControl(sizes);
  const held = tiles(10);
  for (const tile of held) {
    [tile.state, tile.size] = ["held", 20_000];
    sizes.learn(tile);
  }
  expect(control.adapt(held, 250_000)).toBe("same");
  expect(control.adapt(tiles(16), 250_000)).toBe("coarser");
  for (let n = 0; n < 50; n++) control.adapt(tiles(1000), 250_000);
  expect(control.adapt(tiles(1000), 250_000)).toBe("same");
});
