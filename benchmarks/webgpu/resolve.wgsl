// Averages samples in linear light, over a sky of one colour, upside down as canvases are.

struct Frame {
  ambientLight: vec3f,
  focal: f32,
  sunLight: vec3f,
  near: f32,
  sky: vec3f,
  samples: u32,
  width: u32,
  height: u32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> depths: array<u32>;
@group(0) @binding(2) var<storage, read> colors: array<u32>;
@group(0) @binding(3) var picture: texture_storage_2d<rgba8unorm, write>;

fn linearFromSrgb(c: vec3f) -> vec3f {
  return select(c / 12.92, pow((c + 0.055) / 1.055, vec3f(2.4)), c >= vec3f(0.04045));
}

fn srgbFromLinear(c: vec3f) -> vec3f {
  return select(12.92 * c, 1.055 * pow(c, vec3f(1.0 / 2.4)) - 0.055, c > vec3f(0.0031308));
}

@compute @workgroup_size(64)
fn resolve(@builtin(global_invocation_id) id: vec3u) {
  let pixel = id.xy;
  if (pixel.x >= frame.width / frame.samples) { return; }
  var sum = vec3f(0.0);
  for (var j = 0u; j < frame.samples; j++) {
    for (var i = 0u; i < frame.samples; i++) {
      let at = (pixel.y * frame.samples + j) * frame.width + pixel.x * frame.samples + i;
      if (depths[at] == 0u) { sum += frame.sky; } else { sum += linearFromSrgb(unpack4x8unorm(colors[at]).xyz); }
    }
  }
  let mean = srgbFromLinear(sum / f32(frame.samples * frame.samples));
  textureStore(picture, vec2u(pixel.x, frame.height / frame.samples - 1u - pixel.y), vec4f(mean, 1.0));
}
