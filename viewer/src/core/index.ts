/** Everything of farfield's viewer that needs no rendering engine. */
export { ArchiveFetcher } from "./archive/fetcher.js";
export { Cell, SharedMeshes } from "./cell.js";
export { cut, nearRadius, type Cut, type CutCell } from "./cut.js";
export { axesOf, PRINCIPAL, viewBin, type Axes } from "./directions.js";
export { FarfieldError, type ErrorTag } from "./errors.js";
export { Fetcher } from "./fetch.js";
export { formatKey, Grid, parseKey, type CellKey } from "./grid.js";
export { decodeIndexTile, type CellEntry, type GeometryEntry } from "./indextile.js";
export { decodeManifest, type Direction, type Manifest, type View } from "./manifest.js";
export { decodeTile, type DecodedTile } from "./orthoview/decode.js";
export type { Found, Source } from "./source.js";
export type { Box, Vector3 } from "./vector.js";
