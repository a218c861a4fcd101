// The light of spec/drawing.md for the meshes of a tile, and what is nearer than the far field left out.
import { DoubleSide, Matrix3, ShaderMaterial, Vector3 } from "three";

const AMBIENT = 0.3;
const [AZIMUTH, ELEVATION] = [(225 * Math.PI) / 180, (35 * Math.PI) / 180];
const SUN = new Vector3(Math.sin(AZIMUTH) * Math.cos(ELEVATION), Math.cos(AZIMUTH) * Math.cos(ELEVATION), Math.sin(ELEVATION));

const VERTEX = `
uniform mat3 mapTransform;
varying vec2 at;
varying vec3 facing, place, tint;
void main() {
  mat4 model = modelMatrix;
  #ifdef USE_INSTANCING
    model = model * instanceMatrix;
  #endif
  place = (model * vec4(position, 1.0)).xyz;
  facing = mat3(model) * normal;
  at = vec2(0.0);
  tint = vec3(1.0);
  #ifdef TEXTURED
    at = (mapTransform * vec3(uv, 1.0)).xy;
  #endif
  #ifdef TINTED
    tint = color.rgb;
  #endif
  gl_Position = projectionMatrix * viewMatrix * vec4(place, 1.0);
}`;

const FRAGMENT = `
uniform sampler2D map;
uniform vec3 base, sun, eye, corner;
uniform float cutoff, leaf, near;
varying vec2 at;
varying vec3 facing, place, tint;
void main() {
  // A leaf cell nearer than the far field is left out whole; faces on a cell's floor belong to it.
  vec3 low = floor((place - corner) / leaf + 1e-3) * leaf + corner;
  vec3 gap = max(max(low - eye, eye - low - leaf), 0.0);
  if (dot(gap, gap) < near * near) discard;
  vec3 albedo = base * tint;
  #ifdef TEXTURED
    // Whether a texel is a hole is not averaged away with distance.
    if (cutoff > 0.0 && textureLod(map, at, 0.0).a < cutoff) discard;
    albedo *= texture2D(map, at).rgb;
  #endif
  vec3 n = normalize(facing);
  if (TURNED == 1 && dot(n, place - eye) > 0.0) n = -n;
  gl_FragColor = vec4(min(albedo * (${AMBIENT} + max(dot(n, sun), 0.0)), 1.0), 1.0);
}`;

/** Gives every mesh of a tile that material. view: as in show.js. */
export function lit(scene, view) {
  scene.traverse((object) => {
    if (object.isMesh) object.material = materialOf(object, view);
  });
}

function materialOf({ material: { map, color, side, alphaTest, alphaMode }, geometry }, { eye, corner, leaf, near }) {
  const defines = { TURNED: side === DoubleSide ? 1 : 0 };
  if (map) {
    defines.TEXTURED = "";
    // 4 gives 0.8 dB more in Tokyo, and frames of 26 s in place of 0.4 in software.
    map.anisotropy = 1;
    map.updateMatrix();
  }
  const vertexColors = geometry.hasAttribute("color");
  if (vertexColors) defines.TINTED = "";
  return new ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    defines,
    // True pictures show the back of open shells, lit as their front.
    side: DoubleSide,
    vertexColors,
    uniforms: {
      map: { value: map },
      mapTransform: { value: map ? map.matrix : new Matrix3() },
      base: { value: new Vector3(color.r, color.g, color.b) },
      sun: { value: SUN },
      eye: { value: new Vector3(...eye) },
      corner: { value: new Vector3(...corner) },
      cutoff: { value: alphaTest },
      leaf: { value: leaf },
      near: { value: near },
    },
  });
}
