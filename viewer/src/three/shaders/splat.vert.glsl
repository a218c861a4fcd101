// One splat a pixel of an orthoview (spec/drawing.md, Splats). Vectors are in the layer's own frame (u, v, w), metres;
// screen positions are in pixels of the frame that is drawn, from its lower left corner.

in uvec3 position; // as core/orthoview/decode.ts lays it out

uniform vec3 origin;    // from the eye to lattice column and row 0 of the tile at depth code 0
uniform float pitch;
uniform float behind;   // metres by which finer pictures of the same go before it
uniform ivec2 lattice;  // column and row of the tile's first pixel
uniform vec3 toX;       // rows of the linear part of the projection
uniform vec3 toY;
uniform vec3 toW;       // the view axis
uniform mat3 toWorld;   // from the layer's frame to the world's axes
uniform vec3 sun;
uniform float focal;    // pixels
uniform float near;
uniform float largest;  // widest point the card draws
uniform bool bothSides; // for shadows: what faces away casts them too
uniform vec2 frame;     // width and height, pixels

flat out vec4 centre;   // x, y, depth, and what it is: 0 a single pixel, 1 an ellipse, else the edge of a patch
flat out vec4 axes;     // inverse(T): what the screen is in axes of the footprint; of a patch, its axes U, V on the screen
flat out vec2 slope;    // of depth over the screen; of a patch, over its axes, for depth 1
flat out vec4 radiance; // alpha: see light.glsl; of a patch, its middle from the eye and its first texel
flat out vec2 tilt;     // of a patch, pitches a pitch

const vec4 NOWHERE = vec4(2.0, 2.0, 2.0, 1.0);
const float STEEPEST = 4.0;
const float WIDEST_FILLING = 1.0 / 96.0; // of the frame's height
const float PATCH_MARGIN = 0.1; // pitches, as in core/orthoview/patches.ts
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

// Places a footprint of half axes `size` long in a surface that rises by `ab`.
void lay(vec2 ab, float size, vec2 s, float inverseD, out vec2 U, out vec2 V, out vec2 along) {
    along = size * (toW.xy + ab * toW.z);
    U = (size * vec2(toX.x + ab.x * toX.z, toY.x + ab.x * toY.z) - s * along.x) * inverseD;
    V = (size * vec2(toX.y + ab.y * toX.z, toY.y + ab.y * toY.z) - s * along.y) * inverseD;
}

// A square of pixels in a plane, which are looked up for each fragment (core/orthoview/patches.ts).
void placePatch(uint column, uint row, float depth) {
    float edge = float(2u << ((position.z >> 22) & 3u));
    depth += 0.5 * float((position.z >> 24) & 1u);
    tilt = (vec2(float(position.z & 2047u), float((position.z >> 11) & 2047u)) - 1024.0) / 128.0;
    vec3 c = origin + vec3(vec2(float(column), float(row)) + 0.5 * edge, depth * 0.125) * pitch;
    float d = dot(toW, c);
    if (d <= near) return;
    float inverseD = 1.0 / d;
    vec2 s = vec2(dot(toX, c), dot(toY, c)) * inverseD;
    vec2 U, V, along;
    lay(tilt, pitch * (0.5 * edge + PATCH_MARGIN), s, inverseD, U, V, along);
    slope = along * inverseD;
    // The far corners of its square, in true perspective.
    vec2 reach = 2.0 * max(
        max(abs(U + V) / max(1.0 + slope.x + slope.y, 0.05), abs(U - V) / max(1.0 + slope.x - slope.y, 0.05)),
        max(abs(U - V) / max(1.0 - slope.x + slope.y, 0.05), abs(U + V) / max(1.0 - slope.x - slope.y, 0.05)));
    if (max(reach.x, reach.y) > frame.y) return;
    axes = vec4(U, V);
    // Cards leave points out by their middles: at the border of the picture it is moved inside.
    vec2 inside = clamp(s, vec2(0.0), frame);
    vec2 moved = abs(s - inside);
    if (any(greaterThan(moved, 0.5 * reach))) return;
    reach += 2.0 * moved;
    centre = vec4(s, d, edge);
    radiance = vec4(c, float((position.y & 0xffffffu) * 4u));
    gl_PointSize = clamp(max(reach.x, reach.y) + 0.05, 1.05, largest);
    gl_Position = vec4(clamp(2.0 * inside / frame - 1.0, -1.0, 1.0), 0.0, 1.0);
}

void main() {
    gl_Position = NOWHERE;
    gl_PointSize = 1.0;
    uint column = position.x & 4095u;
    uint row = (position.x >> 12) & 4095u;
    float depth = float((position.x >> 24) | ((position.y >> 24) << 8));
    tilt = vec2(0.0);
    if ((position.z & 0x80000000u) != 0u) {
        placePatch(column, row, depth);
        return;
    }
    vec3 c = origin + vec3(float(column) + 0.5, float(row) + 0.5, depth * 0.125) * pitch;
    float d = dot(toW, c);
    if (d <= near) return;

    vec3 n = normalOf(position.z);
    float facing = dot(n, c);
    bool connected = (position.z & 0x80000u) != 0u;
    if (connected && facing >= 0.0 && !bothSides) return;
    if (holeNode != 1 && !isHole(toWorld * c)) return;

    // Of two views of the same surface the one that looks at it squarely shows more of it.
    float front = d + pitch * (1.0 - abs(n.z)) + behind;
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
        lay(ab, size, s, inverseD, U, V, along);
    } else {
        U = vec2(size * focal * inverseD, 0.0);
        V = U.yx;
        // What fills gaps must not hide what is there: wide discs show nothing of leaves.
        if (behind > 0.0 && U.x > WIDEST_FILLING * frame.y) return;
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
        axes = vec4(0.0);
        slope = vec2(0.0);
    } else {
        axes = vec4(V.y, -V.x, -U.y, U.x) / det;
        centre = vec4(s, front, 1.0);
        slope = axes.xy * along.x + axes.zw * along.y;
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
