import type { BufferGeometry } from "three";
import type { Features } from "./model.js";

/** As three.js calls `_FEATURE_ID_0`. */
const FEATURE = "_feature_id_0";

/** Of each triangle the feature of its first corner, which is that of all three. Without any, or with what is no number of a feature, 0. */
export function featuresOf(geometry: BufferGeometry, triangles: number): Features {
  const { index } = geometry;
  if (!geometry.hasAttribute(FEATURE)) return 0;
  const told = geometry.getAttribute(FEATURE);
  const found = new Uint32Array(Math.floor(triangles));
  for (let n = 0; n < found.length; n++) found[n] = told.getX(index ? index.getX(3 * n) : 3 * n);
  const most = mostOf(found);
  if (found.every((feature) => feature === most)) return most;
  return most < 1 << 8 ? Uint8Array.from(found) : most < 1 << 16 ? Uint16Array.from(found) : found;
}

/** The feature of a triangle. */
export function featureOf(features: Features, triangle: number): number {
  return typeof features === "number" ? features : features[triangle]!;
}

/** The highest number of a feature. */
export function mostOf(features: Features): number {
  if (typeof features === "number") return features;
  let most = 0;
  for (const feature of features) most = Math.max(most, feature);
  return most;
}
