import { readdirSync, readFileSync } from "node:fs";

const FOLDER = new URL("../../tests/vectors/", import.meta.url);

/** Names of the files in a folder of the vectors that Python shares, by ending. */
export function listVectors(folder: string, ending: string): string[] {
  return readdirSync(new URL(folder, FOLDER)).filter((name) => name.endsWith(ending)).sort();
}

export function readVector(path: string): Uint8Array {
  return new Uint8Array(readFileSync(new URL(path, FOLDER)));
}

export function readJson<T>(path: string): T {
  return JSON.parse(new TextDecoder().decode(readVector(path))) as T;
}
