import { BufferAttribute, type BufferGeometry, type Material, type Mesh, type MeshBasicMaterial, type MeshStandardMaterial, type Object3D, type Texture } from "three";
import { GLTFLoader, type GLTFParser } from "three/addons/loaders/GLTFLoader.js";
import { checkGlb, glbOf, isCompressed } from "../../core/decode/glb.js";
import { corrupt } from "../../core/errors.js";
import { dracoLoader } from "./draco.js";
import { featuresOf, mostOf } from "./features.js";
import type { NearModel, NearPart, NearSurface, Placements } from "./model.js";
import { textureBytes, type TextureShelf } from "./textures.js";

/** Blended surfaces are drawn as masked at this alpha, as the bake does. */
const BLEND_CUTOFF = 0.5;
const TEXTURE_HASH = /(?:^|\/)texture\/([0-9a-f]+)$/;

/**
 * Reads a GLB of the world, packed or not (spec/world.md, Geometry of a leaf), once `checkGlb` has found nothing in it that the general
 * reader of glTF would follow too far. Positions are taken as they are stored: z up, which the
 * file's root node would turn. Rejects with `corrupt`.
 */
export async function parseNearModel(value: Uint8Array, where: string, shelf: TextureShelf): Promise<NearModel> {
  const bytes = glbOf(value, where);
  checkGlb(bytes, where);
  const taken: (() => void)[] = [];
  /** Those that no other model had before: a city's leaves share their façades, and counted in each they would fill any budget. */
  const own: Promise<Texture>[] = [];
  const loader = new GLTFLoader();
  if (isCompressed(bytes)) loader.setDRACOLoader(await dracoLoader(where));
  loader.register((parser) => ({
    name: "FARFIELD_textures",
    loadTexture: (index: number) => {
      const hash = hashOf(parser, index);
      if (hash === null) return null;
      const cutout = isCutout(parser, index);
      taken.push(() => shelf.release(hash, cutout));
      const isFirst = !shelf.isTaken(hash, cutout);
      const texture = shelf.acquire(hash, cutout);
      if (isFirst) own.push(texture);
      return texture;
    },
  }));
  const release = (): void => taken.forEach((give) => give());
  try {
    const file = await loader.parseAsync(bytes.slice().buffer, "");
    const parts = partsOf(file.scene);
    const placements = await placementsOf(file.parser, file.scene.userData);
    const objects = await objectsOf(file.parser, file.scene.userData);
    if (objects && parts.some(({ features }) => mostOf(features) >= objects.length)) throw corrupt("a feature without an object id", where);
    return modelOf(parts, placements, objects, await Promise.all(own), release);
  } catch (error) {
    release();
    if (error instanceof Error && error.name === "FarfieldError") throw error;
    throw corrupt(`the GLB cannot be read: ${String(error)}`, where);
  }
}

interface MaterialJson {
  readonly alphaMode?: string;
  readonly pbrMetallicRoughness?: { readonly baseColorTexture?: { readonly index: number } };
}

/** Whether a texture's alpha cuts holes. */
function isCutout(parser: GLTFParser, index: number): boolean {
  const { materials = [] } = parser.json as { materials?: MaterialJson[] };
  return materials.some(
    ({ alphaMode, pbrMetallicRoughness: surface }) =>
      (alphaMode === "MASK" || alphaMode === "BLEND") && surface?.baseColorTexture?.index === index,
  );
}

function hashOf(parser: GLTFParser, index: number): string | null {
  const { textures = [], images = [] } = parser.json as { textures?: { source: number }[]; images?: { uri?: string }[] };
  const uri = images[textures[index]?.source ?? -1]?.uri ?? "";
  return TEXTURE_HASH.exec(uri)?.[1] ?? null;
}

const WHITE = { r: 1, g: 1, b: 1 };

function partsOf(scene: Object3D): NearPart[] {
  const parts: NearPart[] = [];
  scene.traverse((object) => {
    const mesh = object as Mesh<BufferGeometry, Material>;
    if (!mesh.isMesh) return;
    const { geometry } = mesh;
    makeSmall(geometry);
    const vertices = geometry.index ?? geometry.getAttribute("position");
    const triangles = vertices.count / 3;
    parts.push({ geometry, surface: surfaceOf(mesh.material, geometry), triangles, features: featuresOf(geometry, triangles) });
    mesh.material.dispose();
  });
  return parts;
}

/** Takes from decompressed attributes what the card needs no room for: 20 of 44 bytes at a statue. */
function makeSmall(geometry: BufferGeometry): void {
  const { index } = geometry;
  const normals = geometry.getAttribute("normal") as BufferAttribute | undefined;
  if (index?.array instanceof Uint32Array && geometry.getAttribute("position").count < 0xffff) {
    geometry.setIndex(new BufferAttribute(new Uint16Array(index.array), 1));
  }
  if (!(normals?.array instanceof Float32Array)) return;
  const bytes = new Int8Array(normals.count * 4);
  for (let n = 0; n < normals.count; n++) {
    for (let axis = 0; axis < 3; axis++) bytes[4 * n + axis] = Math.round(normals.array[3 * n + axis]! * 127);
  }
  geometry.setAttribute("normal", new BufferAttribute(bytes, 4, true));
}

/** What a material of three.js says of a surface. */
export function surfaceOf(material: Material, geometry: BufferGeometry): NearSurface {
  const { color = WHITE, map = null } = material as Partial<MeshStandardMaterial>;
  return {
    map: geometry.hasAttribute("uv") ? map : null,
    factor: [color.r, color.g, color.b, material.opacity],
    cutoff: material.alphaTest > 0 ? material.alphaTest : material.transparent ? BLEND_CUTOFF : 0,
    unlit: (material as MeshBasicMaterial).isMeshBasicMaterial === true,
    colored: geometry.hasAttribute("color"),
  };
}

interface Extras {
  readonly farfield?: { readonly objects?: number; readonly instances?: readonly { mesh: string; transforms: number; objects: number }[] };
}

async function objectsOf(parser: GLTFParser, { farfield: { objects } = {} }: Extras): Promise<Uint32Array | null> {
  return objects === undefined ? null : ((await parser.getDependency("accessor", objects)) as BufferAttribute).array as Uint32Array;
}

function placementsOf(parser: GLTFParser, extras: Extras): Promise<Placements[]> {
  const accessor = (index: number): Promise<BufferAttribute> => parser.getDependency("accessor", index) as Promise<BufferAttribute>;
  return Promise.all(
    (extras.farfield?.instances ?? []).map(async ({ mesh, transforms, objects }) => ({
      mesh,
      transforms: (await accessor(transforms)).array as Float32Array,
      objects: (await accessor(objects)).array as Uint32Array,
    })),
  );
}

function modelOf(
  parts: NearPart[], placements: Placements[], objects: Uint32Array | null, textures: readonly Texture[], release: () => void,
): NearModel {
  let bytes = objects?.byteLength ?? 0;
  for (const { geometry, features } of parts) {
    // Features are for picking, which reads them where they are.
    for (const name of Object.keys(geometry.attributes)) {
      if (!["position", "normal", "uv", "color"].includes(name)) geometry.deleteAttribute(name);
    }
    for (const attribute of Object.values(geometry.attributes)) bytes += (attribute as BufferAttribute).array.byteLength;
    bytes += geometry.index?.array.byteLength ?? 0;
    if (typeof features !== "number") bytes += features.byteLength;
  }
  for (const { transforms } of placements) bytes += transforms.byteLength;
  for (const texture of textures) bytes += textureBytes(texture);
  const dispose = (): void => {
    for (const { geometry } of parts) geometry.dispose();
    release();
  };
  return { parts, placements, objects, bytes, dispose };
}
