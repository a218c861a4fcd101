// Splats (spec/drawing.md) as a compute shader: depth by atomics, then colour where a splat is the nearest. The same
// arithmetic as viewer/src/three/shaders/splat.vert.glsl and splat.frag.glsl, for cells drawn whole.

struct Frame {
  ambientLight: vec3f,
  focal: f32,
  sunLight: vec3f,
  near: f32,
  sky: vec3f, // linear light
  samples: u32, // a side
  width: u32,
  height: u32,
  pixels: u32, // of all tiles
  footprints: array<vec4f, 4>, // by coverage: what the axes of a footprint are scaled by
  open: array<vec4f, 4>, // by coverage: logarithm to base 2 of what is not covered
}

struct Tile {
  origin: vec3f,
  pitch: f32,
  toX: vec3f,
  column: i32,
  toY: vec3f,
  row: i32,
  toW: vec3f,
  chunk: u32, // its first
  sun: vec3f,
  number: u32,
  unused: array<vec4f, 11>, // uniforms begin every 256 bytes
}

struct Splat {
  middle: vec2f,
  depth: f32,
  conic: vec3f, // 0 for a single pixel
  slope: vec2f,
  lower: vec2i, // pixels to look at
  upper: vec2i,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<uniform> ownTile: Tile;
@group(0) @binding(2) var<storage, read> chunks: array<vec2u>; // first pixel and count
@group(0) @binding(3) var<storage, read> words: array<u32>;    // core/orthoview/decode.ts: first words of all pixels, second, third
@group(0) @binding(4) var<storage, read_write> depths: array<atomic<u32>>; // bits of near / d, which order as the floats do
@group(0) @binding(5) var<storage, read_write> colors: array<u32>; // sRGB, alpha: how squarely the sun shines on it
@group(0) @binding(6) var<storage, read_write> list: array<vec2u>; // pixel and tile of what was nearest once: nothing else is at the end
@group(0) @binding(7) var<storage, read_write> listed: array<atomic<u32>, 4>; // workgroups for them (3), and how many they are
@group(0) @binding(8) var<storage, read> tiles: array<Tile>;

const GROUP = 64u;
const STEEPEST = 4.0;
fn latticeHash(i: u32, j: u32) -> u32 {
  var h = (i * 0x9E3779B1u) ^ (j * 0x85EBCA77u);
  h = (h ^ (h >> 15u)) * 0x2C1B3C6Du;
  h = (h ^ (h >> 12u)) * 0x297A2D39u;
  return h ^ (h >> 15u);
}

fn normalOf(code: u32) -> vec3f {
  let s = vec2f(f32(code & 63u), f32((code >> 6u) & 63u)) * (2.0 / 63.0) - 1.0;
  let n = vec2f(s.x + s.y, s.x - s.y) * 0.5;
  return normalize(vec3f(n, -max(0.0, 1.0 - abs(n.x) - abs(n.y))));
}

fn placeOf(tile: Tile, word: vec2u) -> vec3f {
  let cell = vec2f(f32(word.x & 4095u), f32((word.x >> 12u) & 4095u));
  let depth = f32((word.x >> 24u) | ((word.y >> 24u) << 8u));
  return tile.origin + vec3f(cell + 0.5, depth * 0.125) * tile.pitch;
}

// Whether anything is drawn of a pixel, and what.
fn project(tile: Tile, word: vec3u, splat: ptr<function, Splat>) -> bool {
  let c = placeOf(tile, word.xy);
  let d = dot(tile.toW, c);
  if (d <= frame.near) { return false; }
  let n = normalOf(word.z);
  let connected = (word.z & 0x80000u) != 0u;
  if (connected && dot(n, c) >= 0.0) { return false; }
  let inverseD = 1.0 / d;
  let s = vec2f(dot(tile.toX, c), dot(tile.toY, c)) * inverseD;
  let size = vec2f(f32(frame.width), f32(frame.height));
  if (any(s < vec2f(0.0)) || any(s >= size)) { return false; } // as WebGL leaves out points by their middles
  let cover = (word.z >> 12u) & 15u;
  let shrunk = frame.footprints[cover >> 2u][cover & 3u];
  let half = tile.pitch * shrunk;
  var U = vec2f(half * frame.focal * inverseD, 0.0);
  var V = U.yx;
  var along = vec2f(0.0);
  if (connected) {
    let ab = clamp(-n.xy / min(n.z, -0.001), vec2f(-STEEPEST), vec2f(STEEPEST));
    along = half * (tile.toW.xy + ab * tile.toW.z);
    U = (half * vec2f(tile.toX.x + ab.x * tile.toX.z, tile.toY.x + ab.x * tile.toY.z) - s * along.x) * inverseD;
    V = (half * vec2f(tile.toX.y + ab.y * tile.toX.z, tile.toY.y + ab.y * tile.toY.z) - s * along.y) * inverseD;
  }
  let det = U.x * V.y - V.x * U.y;
  let pixel = vec2i(s);
  (*splat).middle = s;
  (*splat).depth = d + tile.pitch * (1.0 - abs(n.z));
  (*splat).conic = vec3f(0.0);
  (*splat).slope = vec2f(0.0);
  (*splat).lower = pixel;
  (*splat).upper = pixel;
  if (1.57079633 * abs(det) < 1.0) {
    let h = latticeHash(u32(tile.column + i32(word.x & 4095u)), u32(tile.row + i32((word.x >> 12u) & 4095u)));
    let share = f32(cover + 1u) * 0.0625;
    let whole = abs(det) / (shrunk * shrunk);
    let chance = select(1.0 - exp2(whole * frame.open[cover >> 2u][cover & 3u]), whole * share, whole >= 1.0);
    return f32(h) * (1.0 / 4294967296.0) < chance;
  }
  let alpha = vec2f(V.y, -V.x) / det;
  let beta = vec2f(-U.y, U.x) / det;
  (*splat).conic = vec3f(
    alpha.x * alpha.x + beta.x * beta.x, 2.0 * (alpha.x * alpha.y + beta.x * beta.y), alpha.y * alpha.y + beta.y * beta.y);
  (*splat).slope = alpha * along.x + beta * along.y;
  let reach = sqrt(U * U + V * V) * 0.70710678;
  if (2.0 * max(reach.x, reach.y) > size.y) { return false; }
  (*splat).lower = max(min(pixel, vec2i(ceil(s - reach - 0.5))), vec2i(0));
  (*splat).upper = min(max(pixel, vec2i(floor(s + reach - 0.5))), vec2i(size) - 1);
  return true;
}

// Bits of near / d of a splat at a pixel, 0 where it is not.
fn depthAt(splat: ptr<function, Splat>, x: i32, y: i32) -> u32 {
  let q = vec2f(f32(x), f32(y)) + 0.5 - (*splat).middle;
  var d = (*splat).depth;
  if (dot((*splat).conic, vec3f(q.x * q.x, q.x * q.y, q.y * q.y)) <= 0.5) {
    d = max(d + dot((*splat).slope, q), 0.5 * d);
  } else if (any(abs(q) > vec2f(0.5))) {
    return 0u;
  }
  return bitcast<u32>(frame.near / max(d, frame.near));
}

fn linearFromSrgb(c: vec3f) -> vec3f {
  return select(c / 12.92, pow((c + 0.055) / 1.055, vec3f(2.4)), c >= vec3f(0.04045));
}

fn srgbFromLinear(c: vec3f) -> vec3f {
  return select(12.92 * c, 1.055 * pow(c, vec3f(1.0 / 2.4)) - 0.055, c > vec3f(0.0031308));
}

fn lambert(cosine: f32, len: f32) -> f32 {
  let mu = len * cosine;
  if (len <= 0.5) { return 0.25 + 0.5 * mu; }
  let spread = (1.0 - len) * (0.36 + 0.28 * len);
  return 0.5 * (mu + sqrt(mu * mu + spread * max(0.0, 1.0 - cosine * cosine)));
}

fn seenFromEye(mean: vec3f, c: vec3f) -> vec3f {
  let eye = -normalize(c);
  let halved = 1.0 + mean.z * 2.0 / 3.0;
  let root = sqrt(max(0.0, halved * halved - (1.0 - dot(mean, mean)) * 5.0 / 9.0));
  let around = min(2.0 / 3.0 * min(1.0, 1.8 * (halved - root)), -mean.z);
  let rest = mean + vec3f(0.0, 0.0, around);
  return select(rest, -rest, dot(rest, eye) < 0.0) + around * eye;
}

// How squarely the sun shines on a pixel, less than 0 if it shines by itself.
fn shareOf(tile: Tile, word: vec3u) -> f32 {
  if ((word.z & 0x100000u) != 0u) { return -1.0; }
  var n = normalOf(word.z);
  var len = f32(((word.z >> 16u) & 7u) + 1u) * 0.125;
  if ((word.z & 0x80000u) == 0u) {
    let seen = seenFromEye(n * len, placeOf(tile, word.xy));
    len = min(length(seen), 1.0);
    n = seen / max(len, 1e-6);
  }
  return lambert(dot(n, tile.sun), len);
}

fn colorOf(albedo: u32, share: f32) -> u32 {
  if (share < 0.0) { return albedo & 0xffffffu; }
  let light = frame.ambientLight + frame.sunLight * share;
  let radiance = min(linearFromSrgb(unpack4x8unorm(albedo).xyz) * light, vec3f(1.0));
  return pack4x8unorm(vec4f(srgbFromLinear(radiance), share));
}

fn wordAt(at: u32) -> vec3u {
  return vec3u(words[at], words[frame.pixels + at], words[2u * frame.pixels + at]);
}

fn wordOf(group: vec3u, lane: u32, word: ptr<function, vec3u>) -> bool {
  let chunk = chunks[ownTile.chunk + group.x];
  *word = wordAt(chunk.x + lane);
  return lane < chunk.y;
}

// Draws the depth of a splat; returns whether it was the nearest anywhere.
fn drawDepth(splat: ptr<function, Splat>) -> bool {
  var won = false;
  for (var y = (*splat).lower.y; y <= (*splat).upper.y; y++) {
    for (var x = (*splat).lower.x; x <= (*splat).upper.x; x++) {
      let mine = depthAt(splat, x, y);
      let at = u32(y) * frame.width + u32(x);
      // Most are hidden: a plain look is cheaper than an atomic maximum.
      if (mine > atomicLoad(&depths[at]) && atomicMax(&depths[at], mine) < mine) { won = true; }
    }
  }
  return won;
}

fn drawColor(splat: ptr<function, Splat>, color: u32) {
  for (var y = (*splat).lower.y; y <= (*splat).upper.y; y++) {
    for (var x = (*splat).lower.x; x <= (*splat).upper.x; x++) {
      let mine = depthAt(splat, x, y);
      let at = u32(y) * frame.width + u32(x);
      if (mine > 0u && atomicLoad(&depths[at]) == mine) { colors[at] = color; }
    }
  }
}

@compute @workgroup_size(GROUP)
fn nearest(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
  var word: vec3u;
  var splat: Splat;
  if (!wordOf(group, lane, &word) || !project(ownTile, word, &splat)) { return; }
  drawDepth(&splat);
}

@compute @workgroup_size(GROUP)
fn nearestListed(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
  var word: vec3u;
  var splat: Splat;
  if (!wordOf(group, lane, &word) || !project(ownTile, word, &splat)) { return; }
  if (!drawDepth(&splat)) { return; }
  let place = atomicAdd(&listed[3], 1u);
  if (place % GROUP == 0u) { atomicAdd(&listed[0], 1u); }
  list[place] = vec2u(chunks[ownTile.chunk + group.x].x + lane, ownTile.number);
}

@compute @workgroup_size(GROUP)
fn color(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
  var word: vec3u;
  var splat: Splat;
  if (!wordOf(group, lane, &word) || !project(ownTile, word, &splat)) { return; }
  drawColor(&splat, colorOf(word.y, shareOf(ownTile, word)));
}

@compute @workgroup_size(GROUP)
fn colorListed(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
  let place = group.x * GROUP + lane;
  if (place >= atomicLoad(&listed[3])) { return; }
  let own = list[place];
  let word = wordAt(own.x);
  let tile = tiles[own.y];
  var splat: Splat;
  if (project(tile, word, &splat)) { drawColor(&splat, colorOf(word.y, shareOf(tile, word))); }
}

// Depth and colour at once: what is nearest may lose its colour to another that is drawn at the same moment. A bound of what may be
// reached, not a way to draw.
@compute @workgroup_size(GROUP)
fn atOnce(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
  var word: vec3u;
  var splat: Splat;
  if (!wordOf(group, lane, &word) || !project(ownTile, word, &splat)) { return; }
  var ready = false;
  var color = 0u;
  for (var y = splat.lower.y; y <= splat.upper.y; y++) {
    for (var x = splat.lower.x; x <= splat.upper.x; x++) {
      let mine = depthAt(&splat, x, y);
      let at = u32(y) * frame.width + u32(x);
      if (mine <= atomicLoad(&depths[at]) || atomicMax(&depths[at], mine) >= mine) { continue; }
      if (!ready) {
        color = colorOf(word.y, shareOf(ownTile, word));
        ready = true;
      }
      colors[at] = color;
    }
  }
}
