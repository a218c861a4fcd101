import program from "../core/decode/worker.ts?worker";

/** Makes a decoding worker from the program that the build has put into this bundle. */
export function makeWorker(): Worker {
  const address = URL.createObjectURL(new Blob([program], { type: "text/javascript" }));
  try {
    return new Worker(address, { name: "farfield decode" });
  } finally {
    // A worker has its address once it is made.
    setTimeout(() => URL.revokeObjectURL(address), 10_000);
  }
}
