// Draws a world of farfield or a 3D Tiles tileset with the same camera, size, samples, light and sky.
import * as THREE from "three";
import { lit } from "./lit.js";
import { Samples } from "./samples.js";

const SIZE = location.search.slice(1).split("x").map(Number);
const SKY = "rgb(158, 191, 235)";
/** Milliseconds between frames while things come in: the picture is looked at only in the end. */
const PAUSE = 150;

const renderer = new THREE.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true });
renderer.setPixelRatio(1);
renderer.setSize(...SIZE);
document.body.append(renderer.domElement);

/**
 * kind: world, tiles or geometry; eye, target, fov: of the camera; depth: metres of its near plane; near: metres that
 * are left out round the eye; leaf, corner: of the world's grid; samples: a side; errorTarget: pixels, of tiles;
 * farGeometry: whether cells of a world may be geometry.
 */
let view = null;
const camera = new THREE.PerspectiveCamera(45, SIZE[0] / SIZE[1], 1, 1000);
camera.up.set(0, 0, 1);

function look() {
  camera.fov = view.fov;
  camera.near = view.depth;
  camera.far = 1e5 * view.depth;
  camera.position.set(...view.eye);
  camera.lookAt(...view.target);
  camera.updateProjectionMatrix();
  camera.updateMatrixWorld();
}

async function openWorld() {
  const { FarfieldWorld } = await import("/world/viewer/farfield.js");
  const { near: nearRadius, samples: supersampling, farGeometry } = view;
  const options = { sky: SKY, farOnly: true, nearRadius, supersampling, farGeometry };
  const world = new FarfieldWorld(new URL("/world/", location.href), { ...options, cacheBytes: 2 ** 31 });
  const scene = new THREE.Scene();
  scene.add(world);
  return {
    update: () => world.update(camera, renderer, false),
    draw() {
      world.invalidate();
      world.update(camera, renderer);
      renderer.setRenderTarget(null);
      renderer.render(scene, camera);
    },
    state() {
      const { tiles, splats, triangles, tiles_pending, cache_bytes } = world.stats;
      return { pending: tiles_pending, seen: [tiles, splats, triangles, cache_bytes], tiles, splats, triangles };
    },
  };
}

async function openTiles() {
  const { TilesRenderer } = await import("3d-tiles-renderer");
  const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
  const { MeshoptDecoder } = await import("meshoptimizer");
  const tiles = new TilesRenderer(new URL("/tiles/tileset.json", location.href).href);
  tiles.manager.addHandler(/\.(gltf|glb)$/g, new GLTFLoader(tiles.manager).setMeshoptDecoder(MeshoptDecoder));
  Object.assign(tiles, { errorTarget: view.errorTarget, loadSiblings: false, loadAncestors: true });
  tiles.lruCache.maxBytesSize = 2 ** 31;
  tiles.lruCache.minBytesSize = 2 ** 30;
  tiles.setCamera(camera);
  tiles.setResolution(camera, ...SIZE);
  leaveOutNear(tiles);
  tiles.addEventListener("load-model", ({ scene }) => lit(scene, view));
  const scene = new THREE.Scene();
  scene.add(tiles.group);
  const samples = new Samples(renderer, SIZE, view.samples, SKY);
  let triangles = 0;
  return {
    update: () => tiles.update(),
    draw() {
      tiles.update();
      samples.draw(scene, camera);
      triangles = samples.triangles;
    },
    state() {
      const { queued, downloading, parsing, failed } = tiles.stats;
      const visible = tiles.visibleTiles.size;
      const loaded = tiles.stats.loaded ?? 0;
      return { pending: queued + downloading + parsing, parsing, seen: [visible, loaded, parsing], tiles: visible, triangles, failed };
    },
  };
}

/** All geometry: every object a mesh that is culled by itself; objects of a kind share their buffers. */
async function openGeometry() {
  const { GLTFLoader } = await import("three/addons/loaders/GLTFLoader.js");
  const loader = new GLTFLoader();
  const scene = new THREE.Scene();
  let state = { pending: 1, seen: [0] };
  const load = async (kind) => (await loader.loadAsync(`/tiles/${kind}.glb`)).scene;
  // Not waited for here: nothing comes before the page has been opened.
  void (async () => {
    const { kinds, objects } = await (await fetch("/tiles/objects.json")).json();
    const found = await Promise.all(Array.from({ length: kinds }, (_, kind) => load(kind)));
    for (const model of found) lit(model, view);
    // glTF is y up.
    const upright = new THREE.Matrix4().makeRotationX(Math.PI / 2);
    for (const [kind, ...rows] of objects) {
      const model = found[kind].clone();
      model.applyMatrix4(new THREE.Matrix4().set(...rows, 0, 0, 0, 1).multiply(upright));
      scene.add(model);
    }
    scene.updateMatrixWorld();
    state = { pending: 0, seen: [1] };
  })();
  const samples = new Samples(renderer, SIZE, view.samples, SKY);
  return {
    update() {},
    draw: () => samples.draw(scene, camera),
    state: () => ({ ...state, triangles: samples.triangles }),
  };
}

/** Nothing is fetched for what is left out, and what stands beside it is as fine as its own distance asks for. */
function leaveOutNear(tiles) {
  const measure = tiles.calculateTileViewError.bind(tiles);
  tiles.calculateTileViewError = (tile, target) => {
    measure(tile, target);
    if (!target.inView) return;
    const { boundingVolume } = tile.engineData;
    if (farthest(tile.boundingVolume.box, view.eye) < view.near) target.inView = false;
    const away = Math.max(boundingVolume.distanceToPoint(camera.position), view.near);
    target.error = tile.geometricError / (away * tiles.cameraInfo[0].sseDenominator);
  };
}

function farthest(box, eye) {
  const gaps = [0, 1, 2].map((k) => Math.abs(box[k] - eye[k]) + box[3 + 4 * k]);
  return Math.hypot(...gaps);
}

let shown = null;
let turns = 0;

function pixel() {
  const gl = renderer.getContext();
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
}

window.show = {
  async open(given) {
    view = given;
    look();
    shown = await { world: openWorld, tiles: openTiles, geometry: openGeometry }[given.kind]();
    const turn = () => {
      shown.update();
      turns++;
      setTimeout(turn, PAUSE);
    };
    turn();
  },
  state: () => ({ ...shown.state(), turns }),
  /** Milliseconds of a frame, until its pixels can be read. */
  draw() {
    const begun = performance.now();
    shown.draw();
    pixel();
    return performance.now() - begun;
  },
  /** What was drawn last. */
  picture() {
    return renderer.domElement.toDataURL("image/png");
  },
};
