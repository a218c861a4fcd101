// The footprint of a splat, or a patch of pixels. Depth is near / d: floats then resolve all distances alike.

uniform float near;
uniform float pitch;
uniform float behind;
uniform mat3 toWorld; // from the layer's frame to the world's axes
uniform vec3 sun;
uniform bool bothSides;
uniform highp usampler2D texels; // of the tile's patches: color, surface

flat in vec4 centre;
flat in vec4 axes;
flat in vec2 slope;
flat in vec4 radiance;
flat in vec2 tilt;

out vec4 color;

const float PATCH_MARGIN = 0.1; // pitches
const int TEXTURE_BITS = 11;    // of the texture's width

// Where a patch is seen, in its axes, -1 to 1 each: in true perspective, since patches may be wide.
vec2 patchPlace(vec2 q) {
    vec2 u = axes.xy - q * slope.x;
    vec2 v = axes.zw - q * slope.y;
    float det = u.x * v.y - v.x * u.y;
    return vec2(v.y * q.x - v.x * q.y, u.x * q.y - u.y * q.x) / (abs(det) > 1e-9 ? det : 1e-9);
}

// What a patch shows at a place in its axes; moves `d` behind by how obliquely its view sees it, and behind finer pictures.
vec4 patchAt(vec2 at, inout float d) {
    float edge = centre.w;
    vec2 place = at * (0.5 * edge + PATCH_MARGIN); // pitches from the middle
    vec2 pixel = clamp(floor(place + 0.5 * edge), 0.0, edge - 1.0);
    int index = int(radiance.w) + int(pixel.y * edge + pixel.x);
    uvec2 texel = texelFetch(texels, ivec2(index & ((1 << TEXTURE_BITS) - 1), index >> TEXTURE_BITS), 0).rg;
    vec3 c = radiance.xyz + vec3(place, dot(tilt, place)) * pitch;
    vec3 n = normalOf(texel.g);
    if (dot(n, c) >= 0.0 && !bothSides) discard;
    if (holeNode != 1 && !isHole(toWorld * c)) discard;
    d += pitch * (1.0 - abs(n.z)) + behind;
    vec3 albedo = linearFromSrgb(
        vec3(float(texel.r & 255u), float((texel.r >> 8) & 255u), float((texel.r >> 16) & 255u)) / 255.0);
    if ((texel.g & 0x100000u) != 0u) return vec4(albedo, 0.0);
    return lit(albedo, dot(n, sun), float(((texel.g >> 16) & 7u) + 1u) * 0.125);
}

void main() {
    float d = centre.z;
    vec2 q = gl_FragCoord.xy - centre.xy;
    if (centre.w > 1.5) {
        vec2 at = patchPlace(q);
        if (max(abs(at.x), abs(at.y)) > 1.0) {
            if (floor(gl_FragCoord.xy) != floor(centre.xy)) discard;
            at = vec2(0.0);
        }
        d *= 1.0 + dot(slope, at);
        color = patchAt(at, d);
    } else {
        vec2 at = vec2(dot(axes.xy, q), dot(axes.zw, q));
        if (centre.w > 0.5) {
            if (dot(at, at) <= 0.5) d = max(d + dot(slope, q), 0.5 * d);
            else if (floor(gl_FragCoord.xy) != floor(centre.xy)) discard;
        }
        color = radiance;
    }
    gl_FragDepth = near / max(d, near);
}
