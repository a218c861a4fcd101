// Builds the viewer into src/farfield/serve/static: index.html and viewer/*.js.
import { copyFile, mkdir } from "node:fs/promises";
import { fileURLToPath } from "node:url";
import * as esbuild from "esbuild";

const here = new URL("..", import.meta.url);
const root = process.env.FARFIELD_STATIC ?? fileURLToPath(new URL("../src/farfield/serve/static/", here));
const path = (name) => fileURLToPath(new URL(name, here));
const watching = process.argv.includes("--watch");

/** Modules imported as `….ts?worker` become the text of their own bundle. */
const workers = {
  name: "workers",
  setup(build) {
    build.onResolve({ filter: /\?worker$/ }, ({ path: name, resolveDir }) => ({
      path: fileURLToPath(new URL(name.replace(/\?worker$/, ""), `file://${resolveDir}/`)),
      namespace: "worker",
    }));
    build.onLoad({ filter: /.*/, namespace: "worker" }, async ({ path: entry }) => {
      const result = await esbuild.build({ ...common, entryPoints: [entry], format: "iife", write: false });
      return { contents: result.outputFiles[0].text, loader: "text", watchFiles: [entry] };
    });
  },
};

const common = {
  bundle: true,
  minify: !watching,
  target: ["chrome105", "firefox115", "safari16.4"],
  loader: { ".glsl": "text" },
  legalComments: "eof",
  logLevel: "warning",
};

const module = { ...common, outdir: `${root}/viewer`, entryNames: "[name]", format: "esm", plugins: [workers] };
const bundles = [
  { ...module, entryPoints: { app: path("src/app/main.ts") } },
  // For scenes of other people, who bring their own three.js: import map or bundler.
  { ...module, entryPoints: { farfield: path("src/three/index.ts") }, external: ["three", "three/addons/*"] },
];

await mkdir(`${root}/viewer/draco`, { recursive: true });
await copyFile(path("src/app/index.html"), `${root}/index.html`);
for (const name of ["draco_decoder.wasm", "draco_wasm_wrapper.js"]) {
  await copyFile(path(`node_modules/three/examples/jsm/libs/draco/gltf/${name}`), `${root}/viewer/draco/${name}`);
}
for (const bundle of bundles) {
  if (watching) await (await esbuild.context(bundle)).watch();
  else await esbuild.build(bundle);
}
