// Rays through BlockMaps (spec/drawing.md, BlockMaps): the twin of src/farfield/kernels/raycast.py. Depth is near / d.
//
// A ray goes from texel to texel, and leaps where its distances tell that nothing is as high as it for some way. It is counted from where it
// comes into the box, so that it is exact however far the eye is: texels along x and y, metres above code 1 along z, all for 1 along the
// view axis.

flat in vec3 eye;
flat in vec4 shape;
flat in vec4 heights;
flat in vec4 walling;
flat in int layer;

uniform highp usampler2DArray maps; // a map a layer, side by side: tops, slopes, four sides, colours (blockmappage.ts)
uniform int texels;
uniform mat3 toRay; // from pixels to the ray through them, 1 along the view axis; world axes, metres
uniform vec3 sun;
uniform float near;

out vec4 color;

// How a ray came into a texel: by side 0 to 3, or so.
const int FROM_ABOVE = 4; // down to a height that nothing there is above: if it is below the top, then by rounding alone
const int FROM_BELOW = 5; // by the box's lower face
const int BEGAN = 6;      // it began there: a body that it began in does not stop it
// What stops a ray.
const int NOTHING = 0;
const int SIDE = 1;
const int TOP = 2;
// Texels, by which a ray is taken beyond a wall of texels to tell which one it is in.
const float CLOSE = 1e-4;
const float TURN = 0.09817477042468103; // a 64th

uvec4 texelAt(int column, int row) {
    return texelFetch(maps, ivec3(column, row, layer), 0);
}

float heightOf(uint code) {
    return (float(code) - 1.0) * shape.z;
}

// Rise along x and y, metres for each metre.
vec2 slopeAt(ivec2 at) {
    if (walling.z == 0.0) return vec2(0.0);
    ivec2 bytes = ivec2(texelAt(texels + at.x, at.y).rg);
    return vec2(bytes - 256 * ivec2(greaterThan(bytes, ivec2(127)))) / 32.0;
}

// Metres down to which what stands there goes; what goes down to the lowest code goes down for ever.
float floorAt(ivec2 at) {
    if (walling.w == 0.0) return -1e9;
    uint code = texelAt(texels + at.x, at.y).b;
    return code > 1u ? heightOf(code) : -1e9;
}

void main() {
    vec3 ray = toRay * vec3(gl_FragCoord.xy, 1.0);
    vec3 dir = ray / vec3(shape.xy, 1.0);
    // No ray is quite along an axis.
    dir = mix(dir, vec3(1e-10), lessThan(abs(dir), vec3(1e-10)));
    vec3 inverse = 1.0 / dir;
    bvec3 rising = greaterThan(dir, vec3(0.0));
    float n = float(texels);
    float margin = shape.x / MARGIN;
    vec3 lower = vec3(0.0, 0.0, -margin);
    vec3 upper = vec3(n, n, shape.w + margin);
    vec3 first = mix(upper, lower, rising);
    vec3 last = mix(lower, upper, rising);

    // To about the box, and from there into it.
    vec3 reach = (first - eye) * inverse;
    float begin = max(max(reach.x, reach.y), max(reach.z, near));
    vec3 origin = eye + begin * dir;
    vec3 enter = (first - origin) * inverse;
    vec3 exits = (last - origin) * inverse;
    float t = max(max(enter.x, enter.y), max(enter.z, near - begin));
    float leave = min(min(exits.x, exits.y), exits.z);
    if (t >= leave) discard;
    int came = BEGAN;
    if (t == enter.z) came = rising.z ? FROM_BELOW : FROM_ABOVE;
    else if (t == enter.x) came = rising.x ? 0 : 1;
    else if (t == enter.y) came = rising.y ? 2 : 3;
    vec2 ahead = mix(vec2(-CLOSE), vec2(CLOSE), rising.xy);
    ivec2 at = clamp(ivec2(floor(origin.xy + t * dir.xy + ahead)), ivec2(0), ivec2(texels - 1));
    ivec2 onward = ivec2(rising.xy);

    int hit = NOTHING;
    for (int steps = 0; steps < 4 * texels; steps++) {
        uvec4 texel = texelAt(at.x, at.y);
        vec2 sides = (vec2(at + onward) - origin.xy) * inverse.xy;
        float beyond = min(min(sides.x, sides.y), leave);
        float z = origin.z + t * dir.z;
        if (texel.r > 0u) {
            vec3 plane = vec3(slopeAt(at) * shape.xy, heightOf(texel.r));
            vec2 from = origin.xy - vec2(at) - 0.5;
            float above = z - plane.z - dot(plane.xy, from + t * dir.xy);
            float then = origin.z + beyond * dir.z - plane.z - dot(plane.xy, from + beyond * dir.xy);
            float under = floorAt(at);
            if (above < 0.0 && z < under) {
                // Below what stands there, and perhaps on the way up to it.
                if (origin.z + beyond * dir.z > under) {
                    t = (under - origin.z) * inverse.z;
                    hit = TOP;
                }
            } else if (above < 0.0) {
                hit = came == FROM_ABOVE ? TOP : came == BEGAN ? NOTHING : SIDE;
            } else if (then < 0.0) {
                t += (beyond - t) * above / (above - then);
                hit = TOP;
            }
#ifdef HOLES
            // A wall is of the texel behind it, a top of what is above it.
            vec3 inside = hit == SIDE ? vec3(ahead * 10.0 * shape.xy, 0.0) : vec3(0.0, 0.0, margin);
            if (hit != NOTHING && !isHole(ray * (begin + t) + inside)) hit = NOTHING;
#endif
            if (hit != NOTHING) break;
        }
        if (beyond >= leave) break;
        // As far as nothing is as high as the ray, of three heights that it may be above; a distance of 1 or 0 leads nowhere.
        vec3 free = vec3(texel.gba);
        vec3 endsX = ((rising.x ? free : 1.0 - free) + float(at.x) - origin.x) * inverse.x;
        vec3 endsY = ((rising.y ? free : 1.0 - free) + float(at.y) - origin.y) * inverse.y;
        vec3 fallen = rising.z ? vec3(leave) : (heights.xyz - origin.z) * inverse.z;
        vec3 leaps = mix(min(min(endsX, endsY), fallen), vec3(beyond), lessThan(vec3(z), heights.xyz));
        int k = leaps.z >= max(leaps.x, leaps.y) ? 2 : leaps.y >= leaps.x ? 1 : 0;
        float best = leaps[k];
        bool byX = endsX[k] <= endsY[k];
        bool down = fallen[k] < min(endsX[k], endsY[k]);
        if (best <= beyond) {
            best = beyond;
            byX = sides.x <= sides.y;
            down = false;
        }
        if (best >= leave) break;
        t = best;
        vec2 p = origin.xy + t * dir.xy;
        // Never back: at corners rounding would lead a ray to and fro.
        ivec2 there = ivec2(floor(p));
        at.x = rising.x ? max(at.x, there.x) : min(at.x, there.x);
        at.y = rising.y ? max(at.y, there.y) : min(at.y, there.y);
        if (down) {
            came = FROM_ABOVE;
            at = clamp(at, ivec2(0), ivec2(texels - 1));
        } else if (byX) {
            at.x = int(floor(p.x + 0.5)) - 1 + onward.x;
            came = rising.x ? 0 : 1;
        } else {
            at.y = int(floor(p.y + 0.5)) - 1 + onward.y;
            came = rising.y ? 2 : 3;
        }
        if (any(lessThan(at, ivec2(0))) || any(greaterThanEqual(at, ivec2(texels)))) break;
    }
    if (hit == NOTHING) discard;

    ivec2 shown = at;
    vec3 normal = vec3(-slopeAt(at), 1.0);
    if (hit == SIDE && came < FROM_ABOVE) {
        uvec4 side = texelAt((2 + came) * texels + at.x, at.y);
        if (side.b > 0u) {
            vec3 p = origin + t * dir;
            float up = heightOf(255u);
            float down = 0.0;
            if (walling.y > 0.0) {
                up = heightOf(texelAt(at.x, at.y).r);
                ivec2 beside = at + (came < 2 ? ivec2(2 * came - 1, 0) : ivec2(0, 2 * came - 5));
                bool within = all(greaterThanEqual(beside, ivec2(0))) && all(lessThan(beside, ivec2(texels)));
                uint code = within ? texelAt(beside.x, beside.y).r : 0u;
                if (code > 0u) down = heightOf(code);
                down = max(down, floorAt(at));
            }
            float along = came < 2 ? p.y - float(at.y) : p.x - float(at.x);
            int column = clamp(int(floor(along * walling.x)), 0, int(walling.x) - 1);
            // Limited before it is an integer: of a wall without height, which a texel of code 1 has, it is large beyond those.
            float below = (up - p.z) / max(up - down, 1e-9) * float(side.b);
            int row = int(clamp(floor(below), 0.0, float(side.b) - 1.0));
            shown = ivec2(texels + int(side.r) + column, int(side.g) + row);
            normal = vec3(cos(float(side.a) * TURN), sin(float(side.a) * TURN), 0.0);
        }
    }
    vec3 albedo = linearFromSrgb(vec3(texelAt(6 * texels + shown.x, shown.y).rgb) / 255.0);
    color = lit(albedo, dot(normalize(normal), sun), 1.0);
    gl_FragDepth = near / (begin + t + heights.w);
}
