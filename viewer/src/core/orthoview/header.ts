import { crc32 } from "../crc32.js";
import { corrupt } from "../errors.js";

const HEADER_BYTES = 40;
const ENTRY_BYTES = 8;
const LARGEST = 4096;

export const PLANE = { depth: 1, color: 2, normal: 3, coverage: 4, flags: 5, unlit: 6, objects: 7 } as const;
export const CODEC = { raw: 0, deflate: 1, webp: 2, coded: 3 } as const;
const MOST_PLANES = 64;

/** What files with the header of a tile are: how they begin, and the planes that are read of them. */
export interface TileKind {
  readonly magic: number;
  readonly planes: ReadonlySet<number>;
  readonly name: string;
}

const { objects, ...PICTURED } = PLANE;
/** "FFOV". */
export const ORTHOVIEW: TileKind = { magic: 0x564f4646, planes: new Set(Object.values(PICTURED)), name: "an orthoview tile" };
/** "FFID": object ids of an orthoview tile. */
export const OBJECT_IDS: TileKind = { magic: 0x44494646, planes: new Set([objects]), name: "the object ids of an orthoview tile" };

/** Bytes of a plane as they are stored. */
export interface StoredPlane {
  /** Of CODEC, where the kind is of PLANE. */
  readonly codec: number;
  readonly bytes: Uint8Array;
}

/** What a tile says of itself (spec/orthoview.md, Header). */
export interface TileHeader {
  readonly direction: number;
  readonly layer: number;
  readonly level: number;
  /** Lattice column and row of the first pixel. */
  readonly x: number;
  readonly y: number;
  readonly width: number;
  readonly height: number;
  /** Depth steps of code 0. */
  readonly depthBase: number;
  /** Number of pixels with a surface. */
  readonly valid: number;
  readonly planes: ReadonlyMap<number, StoredPlane>;
}

/** Reads the header and finds the planes. Throws `corrupt` unless the whole tile is sound. */
export function readTile(bytes: Uint8Array, where: string, kind = ORTHOVIEW): TileHeader {
  if (bytes.length < HEADER_BYTES) throw corrupt("tile is cut short", where);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  if (view.getUint32(0, true) !== kind.magic || view.getUint16(4, true) !== 1) throw corrupt(`not ${kind.name} of a known version`, where);
  if (checksum(bytes) !== view.getUint32(36, true)) throw corrupt("tile is damaged", where);
  const header = {
    direction: view.getUint8(6),
    layer: view.getUint8(7),
    level: view.getInt32(8, true),
    x: view.getInt32(12, true),
    y: view.getInt32(16, true),
    width: view.getUint16(20, true),
    height: view.getUint16(22, true),
    depthBase: view.getInt32(24, true),
    valid: view.getUint32(28, true),
  };
  const { width, height, valid } = header;
  const sane = width >= 1 && width <= LARGEST && height >= 1 && height <= LARGEST && valid >= 1;
  if (!sane || valid > width * height) throw corrupt("tile of an impossible size", where);
  if (header.layer > 1 || view.getUint16(34, true) !== 0) throw corrupt("not a tile of version 1", where);
  return { ...header, planes: readPlanes(bytes, view, kind.planes, where) };
}

function checksum(bytes: Uint8Array): number {
  const zeros = new Uint8Array(4);
  return crc32(bytes.subarray(HEADER_BYTES), crc32(zeros, crc32(bytes.subarray(0, 36))));
}

function readPlanes(bytes: Uint8Array, view: DataView, known: ReadonlySet<number>, where: string): Map<number, StoredPlane> {
  const count = view.getUint16(32, true);
  const planes = new Map<number, StoredPlane>();
  let at = HEADER_BYTES + count * ENTRY_BYTES;
  if (count > MOST_PLANES || at > bytes.length) throw corrupt("tile is cut short", where);
  for (let n = 0; n < count; n++) {
    const entry = HEADER_BYTES + n * ENTRY_BYTES;
    const [kind, codec] = [view.getUint8(entry), view.getUint8(entry + 1)];
    const end = at + view.getUint32(entry + 4, true);
    if (end > bytes.length) throw corrupt("tile is cut short", where);
    if (planes.has(kind)) throw corrupt(`plane ${kind} is there twice`, where);
    if (view.getUint16(entry + 2, true) !== 0) throw corrupt(`plane ${kind} is not of version 1`, where);
    if (known.has(kind) && !allowed(kind, codec)) throw corrupt(`plane ${kind} in an unknown codec`, where);
    planes.set(kind, { codec, bytes: bytes.subarray(at, end) });
    at = end;
  }
  if (at !== bytes.length) throw corrupt("bytes behind the last plane", where);
  return planes;
}

function allowed(kind: number, codec: number): boolean {
  return codec <= CODEC.coded && (kind === PLANE.color) === (codec === CODEC.webp);
}
