import { corrupt } from "../errors.js";
import { isCount, isHash, isList, isObject, type Json } from "../limits.js";
import { isPacked, unpack } from "../packed.js";
import { DICTIONARY } from "./dictionary.js";
import { claims } from "./draco.js";

/** "FFGL". */
const PACKED = { magic: 0x4c474646, largest: 1 << 30, name: "near geometry", dictionary: DICTIONARY };
const DRACO = "KHR_draco_mesh_compression";

const HEADER_BYTES = 20;
const [GLTF, JSON_CHUNK] = [0x46546c67, 0x4e4f534a];
const COMPONENT_BYTES: Readonly<Record<number, number>> = { 5120: 1, 5121: 1, 5123: 2, 5125: 4, 5126: 4 };
const WIDTH: Readonly<Record<string, number>> = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT4: 16 };
const TEXTURE = /^(\.\.\/){1,4}texture\/[0-9a-f]{16}$/;
/** What near geometry has none of, and what a reader of glTF would walk, fetch or allocate for. */
const NOTHING_OF = ["animations", "skins", "cameras", "extensions"];

/** The GLB of a value; one from before they were packed is its own. Throws `corrupt`. */
export function glbOf(value: Uint8Array, where: string): Uint8Array {
  return isPacked(value, PACKED) ? unpack(value, PACKED, where) : value;
}

/** Whether primitives of a GLB that has been checked are compressed. */
export function isCompressed(bytes: Uint8Array): boolean {
  const length = new DataView(bytes.buffer, bytes.byteOffset).getUint32(12, true);
  return new TextDecoder().decode(bytes.subarray(HEADER_BYTES, HEADER_BYTES + length)).includes(DRACO);
}

/**
 * Checks a GLB of the world (spec/world.md, Geometry of a leaf) before a general reader of glTF sees it: that reader would fetch any
 * address, follow nodes in a circle, and allocate for whatever an accessor claims. Then it takes at most 64 bytes for each byte of
 * the file and for each vertex of compressed primitives, which are at most 16 for each byte. Throws `corrupt`.
 */
export function checkGlb(bytes: Uint8Array, where: string): void {
  const fault = faultOf(bytes);
  if (fault) throw corrupt(`near geometry is damaged: ${fault}`, where);
}

function faultOf(bytes: Uint8Array): string | null {
  if (bytes.length < HEADER_BYTES) return "cut short";
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  const length = view.getUint32(12, true);
  const head = view.getUint32(0, true) === GLTF && view.getUint32(4, true) === 2 && view.getUint32(8, true) === bytes.length;
  if (!head || view.getUint32(16, true) !== JSON_CHUNK || length > bytes.length - HEADER_BYTES) return "not a GLB of that length";
  const json = parse(bytes.subarray(HEADER_BYTES, HEADER_BYTES + length));
  if (!json) return "without JSON";
  const body = Math.max(0, bytes.length - HEADER_BYTES - length - 8);
  if (NOTHING_OF.some((name) => json[name] !== undefined)) return "more than near geometry";
  const data = bytes.subarray(bytes.length - body);
  return faultOfBytes(json, body) ?? faultOfMeshes(json, data) ?? faultOfNotes(json);
}

function parse(text: Uint8Array): Json | null {
  try {
    const found: unknown = JSON.parse(new TextDecoder().decode(text));
    return isObject(found) ? found : null;
  } catch {
    return null;
  }
}

/** A list of objects; null when it is something else. */
function objects(json: Json, name: string): readonly Json[] | null {
  const found = json[name] ?? [];
  return isList(found, isObject) ? found : null;
}

/** Buffers, their parts and what lies in them: no part beyond the body, all together no longer than it. */
function faultOfBytes(json: Json, body: number): string | null {
  const [buffers, views, accessors] = [objects(json, "buffers"), objects(json, "bufferViews"), objects(json, "accessors")];
  if (!buffers || !views || !accessors || buffers.length > 1) return "its lists";
  if (buffers.some(({ uri, byteLength }) => uri !== undefined || !isCount(byteLength, body))) return "a buffer";
  let taken = 0;
  for (const { buffer, byteOffset = 0, byteLength, byteStride, extensions } of views) {
    const sane = buffer === 0 && extensions === undefined && isCount(byteOffset) && isCount(byteLength);
    if (!sane || (byteOffset as number) + (byteLength as number) > body) return "a buffer view";
    if (byteStride !== undefined && (!isCount(byteStride, 252) || byteStride === 0)) return "a stride";
    taken += byteLength as number;
  }
  if (taken > body) return "views share their bytes";
  return accessors.every((accessor) => isWithin(accessor, views)) ? null : "an accessor";
}

/** One without a view is of a compressed primitive (isPrimitive). */
function isWithin({ bufferView, byteOffset = 0, componentType, type, count, sparse }: Json, views: readonly Json[]): boolean {
  const width = (COMPONENT_BYTES[componentType as number] ?? NaN) * (WIDTH[type as string] ?? NaN);
  const view = views[bufferView as number];
  if (bufferView === undefined) return sparse === undefined && isCount(count);
  if (!view || sparse !== undefined || byteOffset !== 0 || !isCount(count)) return false;
  const stride = (view["byteStride"] as number | undefined) ?? width;
  return stride >= width && count * stride <= (view["byteLength"] as number);
}

/** Meshes, images and nodes: one node deep, every attribute with as many rows, images only of the world. */
function faultOfMeshes(json: Json, body: Uint8Array): string | null {
  const [meshes, nodes, images] = [objects(json, "meshes"), objects(json, "nodes"), objects(json, "images")];
  if (!meshes || !nodes || !images) return "its lists";
  if (images.some(({ uri, bufferView }) => bufferView !== undefined || typeof uri !== "string" || !TEXTURE.test(uri))) return "an image";
  if (nodes.some((node) => ["children", "skin", "camera", "extensions"].some((name) => node[name] !== undefined))) return "a node";
  const accessors = (json["accessors"] ?? []) as readonly Json[];
  const views = (json["bufferViews"] ?? []) as readonly Json[];
  for (const mesh of meshes) {
    const primitives = objects(mesh, "primitives");
    if (!primitives || primitives.length === 0 || !primitives.every((one) => isPrimitive(one, accessors, views, body))) return "a primitive";
  }
  return null;
}

function isPrimitive(
  { attributes, indices, mode = 4, targets, extensions }: Json, accessors: readonly Json[], views: readonly Json[], body: Uint8Array,
): boolean {
  const corners = accessors[indices as number];
  if (!isObject(attributes) || mode !== 4 || targets !== undefined || !corners) return false;
  const own = Object.values(attributes).map((index) => accessors[index as number]);
  const count = own[0]?.["count"];
  if (attributes["POSITION"] === undefined || count === undefined || !own.every((accessor) => accessor?.["count"] === count)) return false;
  const packed = isObject(extensions) ? extensions[DRACO] : undefined;
  if (packed === undefined) return [...own, corners].every((accessor) => accessor!["bufferView"] !== undefined);
  const view = isObject(packed) && isObject(packed["attributes"]) ? views[packed["bufferView"] as number] : undefined;
  if (!view) return false;
  const [begin, length] = [(view["byteOffset"] ?? 0) as number, view["byteLength"] as number];
  return claims(body.subarray(begin, begin + length), count as number, (corners["count"] as number) / 3);
}

/** Object ids of the features, and instances: a matrix and an object id for each. */
function faultOfNotes(json: Json): string | null {
  const scenes = objects(json, "scenes");
  if (!scenes) return "its scenes";
  const accessors = (json["accessors"] ?? []) as readonly Json[];
  for (const { extras } of scenes) {
    const notes = isObject(extras) ? extras["farfield"] : undefined;
    const listed = isObject(notes) ? (notes["instances"] ?? []) : [];
    const own = isObject(notes) ? notes["objects"] : undefined;
    if (own !== undefined && !isIds(accessors[own as number])) return "its object ids";
    if (!isList(listed, isObject)) return "its instances";
    for (const { mesh, transforms, objects: ids } of listed) {
      const [matrix, id] = [accessors[transforms as number], accessors[ids as number]];
      const typed = matrix?.["bufferView"] !== undefined && matrix["type"] === "MAT4" && matrix["componentType"] === 5126 && isIds(id);
      if (!isHash(mesh) || !typed || matrix["count"] !== id!["count"]) return "an instance";
    }
  }
  return null;
}

function isIds(accessor: Json | undefined): boolean {
  return accessor?.["bufferView"] !== undefined && accessor["type"] === "SCALAR" && accessor["componentType"] === 5125;
}
