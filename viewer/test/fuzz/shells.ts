/** Ways into a value: a part of it is damaged, and lengths and checksums are made right around it (tests/fuzz/shells.py). */
import { deflateRawSync, inflateRawSync } from "node:zlib";
import { crc32 } from "../../src/core/crc32.js";
import { DICTIONARY } from "../../src/core/decode/dictionary.js";
import { glbOf } from "../../src/core/decode/glb.js";
import { CODEC, OBJECT_IDS, ORTHOVIEW, readTile, type StoredPlane } from "../../src/core/orthoview/header.js";
import { joined } from "./mutate.js";

export interface Shell {
  readonly name: string;
  /** The part of a valid value; null when it has none. */
  open(value: Uint8Array): Uint8Array | null;
  /** A valid value and what replaces its part. */
  close(value: Uint8Array, part: Uint8Array): Uint8Array;
  /** The part is JSON: its nodes are damaged as well. */
  readonly json?: boolean;
}

export const BARE: Shell = { name: "bare", open: (value) => value, close: (_, part) => part };
export const BARE_JSON: Shell = { ...BARE, json: true };

const u32 = (...numbers: number[]): Uint8Array => new Uint8Array(Uint32Array.from(numbers).buffer);
export const deflated = (content: Uint8Array): Uint8Array => new Uint8Array(deflateRawSync(content));

/** A tile with a right checksum. */
export function sealed(tile: Uint8Array): Uint8Array {
  if (tile.length < 40) return tile;
  const empty = joined(tile.slice(0, 36), new Uint8Array(4), tile.slice(40));
  empty.set(u32(crc32(empty)), 36);
  return empty;
}

export const SEALED: Shell = { ...BARE, name: "sealed", close: (_, part) => sealed(part) };

/** A tile with other planes in place of its own, of the same kinds in the same order. */
export function withPlanes(tile: Uint8Array, planes: ReadonlyMap<number, StoredPlane>): Uint8Array {
  const header = tile.slice(0, 40 + 8 * planes.size);
  [...planes.values()].forEach(({ codec, bytes }, n) => {
    header[41 + 8 * n] = codec;
    header.set(u32(bytes.length), 44 + 8 * n);
  });
  return sealed(joined(header, ...[...planes.values()].map(({ bytes }) => bytes)));
}

/** Planes of a tile, or of its object ids. */
function planesOf(tile: Uint8Array): Map<number, StoredPlane> {
  const kind = new DataView(tile.buffer, tile.byteOffset).getUint32(0, true) === OBJECT_IDS.magic ? OBJECT_IDS : ORTHOVIEW;
  return new Map(readTile(tile, "", kind).planes);
}

/** A part of one plane of a tile, of all its bytes. */
function within(name: string, kind: number, open: (plane: StoredPlane) => Uint8Array | null, close: (plane: StoredPlane, part: Uint8Array) => Uint8Array): Shell {
  return {
    name: `${name} ${kind}`,
    open: (tile) => {
      const plane = planesOf(tile).get(kind);
      return plane ? open(plane) : null;
    },
    close: (tile, part) => {
      const planes = planesOf(tile);
      const plane = planes.get(kind)!;
      return withPlanes(tile, planes.set(kind, { ...plane, bytes: close(plane, part) }));
    },
  };
}

/** The content of one plane of a tile; one that is coded as it is. */
export function plane(kind: number): Shell {
  return within(
    "plane", kind,
    ({ codec, bytes }) => (codec === CODEC.deflate ? new Uint8Array(inflateRawSync(bytes)) : bytes),
    ({ codec }, part) => (codec === CODEC.deflate ? deflated(part) : part),
  );
}

/** The tables of a coded plane, unpacked. */
export function tables(kind: number): Shell {
  const streamAt = (bytes: Uint8Array): number => 4 + bytes[0]! + 256 * bytes[1]!;
  return within(
    "tables", kind,
    ({ codec, bytes }) => (codec === CODEC.coded ? new Uint8Array(inflateRawSync(bytes.subarray(4, streamAt(bytes)))) : null),
    ({ bytes }, part) => {
      const packed = deflated(part);
      return joined(new Uint8Array(Uint16Array.of(packed.length, part.length).buffer), packed, bytes.subarray(streamAt(bytes)));
    },
  );
}

export const INDEX_TEXT: Shell = {
  name: "text",
  open: (tile) => new Uint8Array(inflateRawSync(tile.subarray(16))),
  close: (tile, text) => joined(tile.slice(0, 8), u32(text.length, crc32(text)), deflated(text)),
  json: true,
};

function chunks(glb: Uint8Array): { text: Uint8Array; body: Uint8Array } {
  const length = new DataView(glb.buffer, glb.byteOffset).getUint32(12, true);
  return { text: glb.slice(20, 20 + length), body: glb.slice(28 + length) };
}

function joinedGlb(text: Uint8Array, body: Uint8Array): Uint8Array {
  const padded = joined(text, new Uint8Array((4 - (text.length % 4)) % 4).fill(32));
  const total = 28 + padded.length + body.length;
  return joined(u32(0x46546c67, 2, total, padded.length, 0x4e4f534a), padded, u32(body.length, 0x004e4942), body);
}

export const GLB_JSON: Shell = {
  name: "json",
  open: (glb) => chunks(glb).text,
  close: (glb, text) => joinedGlb(text, chunks(glb).body),
  json: true,
};

export const GLB_BODY: Shell = {
  name: "body",
  open: (glb) => chunks(glb).body,
  close: (glb, body) => joinedGlb(chunks(glb).text, body),
};

const [FFGL, WITH_DICTIONARY] = [0x4c474646, 2];

/** A value of near geometry, packed by version 2. */
export function packed(glb: Uint8Array): Uint8Array {
  return joined(u32(FFGL, WITH_DICTIONARY, glb.length, crc32(glb)), new Uint8Array(deflateRawSync(glb, { dictionary: DICTIONARY })));
}

export const PACKED: Shell = { name: "packed", open: (value) => glbOf(value, ""), close: (_, glb) => packed(glb) };

/** With length and checksum of what comes out of the stream, if anything does. */
export const PACKED_STREAM: Shell = {
  name: "stream",
  open: (value) => (value[4] === WITH_DICTIONARY ? value.slice(16) : null),
  close: (value, stream) => {
    try {
      const content = inflateRawSync(stream, { dictionary: DICTIONARY, maxOutputLength: 1 << 20 });
      return joined(value.slice(0, 8), u32(content.length, crc32(content)), stream);
    } catch {
      return joined(value.slice(0, 16), stream);
    }
  },
};

/** Where the streams of a BlockMap end. */
function streamEnds(blockmap: Uint8Array): number[] {
  const view = new DataView(blockmap.buffer, blockmap.byteOffset);
  let end = 40;
  return [end, ...[24, 28, 32].map((at) => (end += view.getUint32(at, true)))];
}

/** The content of a stream of a BlockMap: heights, slopes, turns. */
export function blockMapStream(number: 0 | 1 | 2): Shell {
  return {
    name: `stream ${number}`,
    open: (value) => {
      const [from, end] = streamEnds(value).slice(number) as [number, number];
      return end > from ? new Uint8Array(inflateRawSync(value.subarray(from, end))) : null;
    },
    close: (value, part) => {
      const [from, end] = streamEnds(value).slice(number) as [number, number];
      const stream = deflated(part);
      const head = value.slice(0, from);
      head.set(u32(stream.length), 24 + 4 * number);
      return sealed(joined(head, stream, value.slice(end)));
    },
  };
}

/** Object ids of a BlockMap with a right checksum. */
export const SEALED_OBJECTS: Shell = {
  ...BARE,
  name: "sealed",
  close: (_, part) => (part.length < 16 ? part : joined(part.slice(0, 12), u32(crc32(joined(part.slice(0, 12), new Uint8Array(4), part.slice(16)))), part.slice(16))),
};

export const OBJECTS_STREAM: Shell = {
  name: "stream",
  open: (value) => new Uint8Array(inflateRawSync(value.subarray(16))),
  close: (value, part) => SEALED_OBJECTS.close(value, joined(value.slice(0, 16), deflated(part))),
};
