// One splat a pixel of an orthoview (spec/drawing.md, Splats). Vectors are in the layer's own frame (u, v, w), metres;
// screen positions are in pixels of the frame that is drawn, from its lower left corner.

in uvec3 position; // as core/orthoview/decode.ts lays it out

uniform vec3 origin;    // from the eye to lattice column and row 0 of the tile at depth code 0
uniform float pitch;
uniform ivec2 lattice;  // column and row of the tile's first pixel
uniform vec3 toX;       // rows of the linear part of the projection
uniform vec3 toY;
uniform vec3 toW;       // the view axis
uniform vec3 sun;
uniform float focal;    // pixels
uniform float near;
uniform float largest;  // widest point the card draws
uniform bool bothSides; // for shadows: what faces away casts them too
uniform vec2 frame;     // width and height, pixels

flat out vec4 centre;   // x, y, depth, 1 for an ellipse or 0 for a single pixel
flat out vec3 conic;    // |inverse(T) q|^2 = conic . (qx qx, qx qy, qy qy)
flat out vec2 slope;    // of depth over the screen
flat out vec4 radiance; // alpha: see light.glsl

const vec4 NOWHERE = vec4(2.0, 2.0, 2.0, 1.0);
const float STEEPEST = 4.0;
// By coverage 1..16: the ellipses of a plane of equal pixels fill that share of it.
const float FOOTPRINT[16] = float[16](
    0.1995, 0.2821, 0.3455, 0.3989, 0.4460, 0.4886, 0.5278, 0.5642,
    0.5984, 0.6308, 0.6616, 0.6910, 0.7217, 0.7660, 0.8301, 1.0);

uint latticeHash(uint i, uint j) {
    uint h = (i * 0x9E3779B1u) ^ (j * 0x85EBCA77u);
    h = (h ^ (h >> 15)) * 0x2C1B3C6Du;
    h = (h ^ (h >> 12)) * 0x297A2D39u;
    return h ^ (h >> 15);
}

vec3 normalOf(uint code) {
    vec2 s = vec2(float(code & 63u), float((code >> 6) & 63u)) * (2.0 / 63.0) - 1.0;
    vec2 n = vec2(s.x + s.y, s.x - s.y) * 0.5;
    return normalize(vec3(n, -max(0.0, 1.0 - abs(n.x) - abs(n.y))));
}

void main() {
    gl_Position = NOWHERE;
    gl_PointSize = 1.0;
    uint column = position.x & 4095u;
    uint row = (position.x >> 12) & 4095u;
    float depth = float((position.x >> 24) | ((position.y >> 24) << 8));
    vec3 c = origin + vec3(float(column) + 0.5, float(row) + 0.5, depth * 0.125) * pitch;
    float d = dot(toW, c);
    if (d <= near) return;

    vec3 n = normalOf(position.z);
    float facing = dot(n, c);
    bool connected = (position.z & 0x80000u) != 0u;
    if (connected && facing >= 0.0 && !bothSides) return;
    if (!drawnHere(c)) return;

    // Of two views of the same surface the one that looks at it squarely shows more of it.
    float front = d + pitch * (1.0 - abs(n.z));
    float inverseD = 1.0 / d;
    vec2 s = vec2(dot(toX, c), dot(toY, c)) * inverseD;
    uint cover = (position.z >> 12) & 15u; // less one, sixteenths
    float shrunk = FOOTPRINT[cover];
    float size = pitch * shrunk;
    vec2 U, V;
    vec2 along = vec2(0.0); // depth along U and V
    if (connected) {
        float below = min(n.z, -0.001);
        vec2 ab = clamp(-n.xy / below, -STEEPEST, STEEPEST);
        along = size * (toW.xy + ab * toW.z);
        U = (size * vec2(toX.x + ab.x * toX.z, toY.x + ab.x * toY.z) - s * along.x) * inverseD;
        V = (size * vec2(toX.y + ab.y * toX.z, toY.y + ab.y * toY.z) - s * along.y) * inverseD;
    } else {
        U = vec2(size * focal * inverseD, 0.0);
        V = U.yx;
    }
    float det = U.x * V.y - V.x * U.y;
    float area = 1.57079633 * abs(det);
    if (area < 1.0) {
        uint h = latticeHash(uint(lattice.x + int(column)), uint(lattice.y + int(row)));
        float share = float(cover + 1u) * 0.0625;
        float whole = abs(det) / (shrunk * shrunk);
        float chance = whole >= 1.0 ? whole * share : 1.0 - exp2(whole * log2(max(1.0 - share, 1e-30)));
        if (float(h) * (1.0 / 4294967296.0) >= chance) return;
        centre = vec4(s, front, 0.0);
        conic = vec3(0.0);
        slope = vec2(0.0);
    } else {
        vec2 rowAlpha = vec2(V.y, -V.x) / det;
        vec2 rowBeta = vec2(-U.y, U.x) / det;
        centre = vec4(s, front, 1.0);
        conic = vec3(
            rowAlpha.x * rowAlpha.x + rowBeta.x * rowBeta.x,
            2.0 * (rowAlpha.x * rowAlpha.y + rowBeta.x * rowBeta.y),
            rowAlpha.y * rowAlpha.y + rowBeta.y * rowBeta.y);
        slope = rowAlpha * along.x + rowBeta * along.y;
        vec2 reach = sqrt(U * U + V * V) * 1.41421356;
        // So close to the eye the footprint is no ellipse any more, and would hide everything.
        if (max(reach.x, reach.y) > frame.y) return;
        gl_PointSize = clamp(max(reach.x, reach.y) + 0.05, 1.05, largest);
    }

    vec3 albedo = linearFromSrgb(
        vec3(float(position.y & 255u), float((position.y >> 8) & 255u), float((position.y >> 16) & 255u)) / 255.0);
    float len = float(((position.z >> 16) & 7u) + 1u) * 0.125;
    bool unlit = (position.z & 0x100000u) != 0u;
    if (!connected) {
        vec3 seen = seenFromEye(n * len, c);
        len = min(length(seen), 1.0);
        n = seen / max(len, 1e-6);
    }
    radiance = unlit ? vec4(albedo, 0.0) : lit(albedo, dot(n, sun), len);
    gl_Position = vec4(2.0 * s / frame - 1.0, 0.0, 1.0);
}
