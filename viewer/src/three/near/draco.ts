import { DRACOLoader } from "three/addons/loaders/DRACOLoader.js";
import { FarfieldError } from "../../core/errors.js";

/** More would stand idle: a mesh of a million triangles takes 0.3 s. */
const WORKERS = 2;
const FILES = { js: "draco_wasm_wrapper.js", wasm: "draco_decoder.wasm" };

let shared: Promise<DRACOLoader> | null = null;

/**
 * Decodes compressed triangles in workers. Its code is fetched with the first, or before (expectGeometry), from beside this module; when
 * it does not come, `where` is what has to wait for it. Rejects with `network`.
 */
export async function dracoLoader(where: string): Promise<DRACOLoader> {
  shared ??= load();
  try {
    return await shared;
  } catch (error) {
    // Tried anew with the next: the loader itself would keep the failure.
    shared = null;
    throw new FarfieldError("network", `the decoder of near geometry does not come: ${String(error)}`, where);
  }
}

/** Geometry is to be expected: its decoder, 75 kB, is fetched ahead of what it is for. When it does not come, that says so. */
export function expectGeometry(): void {
  dracoLoader("").catch(() => undefined);
}

async function load(): Promise<DRACOLoader> {
  const [js, wasm] = await Promise.all([FILES.js, FILES.wasm].map(fetched));
  return new DRACOLoader().setDecoderPath({ js: js!, wasm: wasm! } as never).setWorkerLimit(WORKERS);
}

/** Address of a file once it is here. */
async function fetched(name: string): Promise<string> {
  const response = await fetch(new URL(`./draco/${name}`, import.meta.url));
  if (!response.ok) throw new Error(`${name}: ${response.status}`);
  return URL.createObjectURL(new Blob([await response.arrayBuffer()]));
}
