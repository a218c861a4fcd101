import { readFileSync } from "node:fs";
import { deflateRawSync } from "node:zlib";
import { describe, expect, it } from "vitest";
import { crc32 } from "../src/core/crc32.js";
import { DICTIONARY, DICTIONARY_TEXT } from "../src/core/decode/dictionary.js";
import { checkGlb, glbOf } from "../src/core/decode/glb.js";
import { inflate } from "../src/core/inflate.js";
import { unpack } from "../src/core/packed.js";
import { Random } from "./fuzz/mutate.js";
import { packed } from "./fuzz/shells.js";
import { readVector } from "./vectors.js";

const file = (path: string): string => readFileSync(new URL(`../../${path}`, import.meta.url), "utf8");
const refusal = (says: string): unknown => expect.objectContaining({ tag: "corrupt", what: expect.stringContaining(says), where: "here" });

describe("the dictionary", () => {
  it("is that of Python and of the specification", () => {
    expect(DICTIONARY_TEXT).toBe(file("src/farfield/represent/geometry/dictionary.txt").replaceAll("\r", ""));
    const sum = crc32(DICTIONARY).toString(16).padStart(8, "0");
    expect(file("spec/world.md")).toContain(`${DICTIONARY.length.toLocaleString("en")} bytes with the CRC-32 \`${sum}\``);
  });
});

describe("near geometry that Python packed", () => {
  it.each(["near/leaf.bin", "near/mesh.bin", "near/version-1/leaf.bin", "near/version-1/mesh.bin"])("%s is read", (name) => {
    checkGlb(glbOf(readVector(name), "here"), "here");
  });

  it("is refused wherever a bit is changed, or reads the same", () => {
    const value = readVector("near/leaf.bin");
    const glb = glbOf(value, "here");
    for (let at = 4; at < value.length; at++) {
      const changed = value.slice();
      changed[at]! ^= 1 << at % 8;
      try {
        expect(glbOf(changed, "here")).toEqual(glb);
      } catch (error) {
        expect(error).toMatchObject({ tag: "corrupt", where: "here" });
      }
    }
  });

  it("is refused when it is cut short or goes on", () => {
    const value = readVector("near/mesh.bin");
    for (const end of [4, 15, 16, 17, 400, value.length - 1]) expect(() => glbOf(value.slice(0, end), "here")).toThrow(refusal(""));
  });

  it("has no version of which nothing is known", () => {
    const value = readVector("near/leaf.bin");
    const kind = { magic: new DataView(value.buffer).getUint32(0, true), largest: 1 << 20, name: "a value" };
    expect(() => unpack(value, kind, "here")).toThrow(refusal("known version"));
    for (const version of [0, 3]) expect(() => glbOf(value.with(4, version), "here")).toThrow(refusal("known version"));
  });
});

describe("streams with a dictionary", () => {
  const deflated = (content: Uint8Array, dictionary: Uint8Array): Uint8Array => new Uint8Array(deflateRawSync(content, { dictionary }));
  const long = new Uint8Array(120_000);
  const random = new Random(5);
  for (let at = 0; at < long.length; at += 300) {
    const begin = Math.floor(random.next() * (DICTIONARY.length - 200));
    long.set(DICTIONARY.subarray(begin, begin + 200), at);
    long.set(random.bytes(100), at + 200);
  }

  it.each([0, 1, 500, 20_000, 120_000])("of %i bytes come out whole", (length) => {
    const content = long.subarray(0, length);
    const stream = deflated(content, DICTIONARY);
    expect(inflate(stream, length, "here", DICTIONARY)).toEqual(content);
    expect(glbOf(packed(content), "here")).toEqual(content);
    for (const wrong of [length - 1, length + 1].filter((one) => one >= 0)) {
      expect(() => inflate(stream, wrong, "here", DICTIONARY)).toThrow(refusal("unpack"));
    }
  });

  it.each([500, 120_000])("of %i bytes that refer to what is before it are refused", (length) => {
    const longer = new Uint8Array([...random.bytes(400), ...DICTIONARY]);
    const content = new Uint8Array([...longer.subarray(0, 300), ...long.subarray(0, length)]);
    const stream = deflated(content, longer);
    expect(inflate(stream, content.length, "here", longer)).toEqual(content);
    expect(() => inflate(stream, content.length, "here", DICTIONARY)).toThrow(refusal("unpack"));
    expect(() => inflate(stream, content.length, "here")).toThrow(refusal("unpack"));
  });
});
