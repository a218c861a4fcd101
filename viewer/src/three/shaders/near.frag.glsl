// Near geometry, lit like the splats (spec/drawing.md, Light). Depth is near / d, as theirs.

in vec3 point;
in vec3 facing;
#ifdef TEXTURED
in vec2 texturePoint;
uniform sampler2D map;
#endif
#ifdef COLORED
in vec4 tint;
#endif
#ifdef CLIPPED
uniform highp sampler3D leaves; // (level + 1) / 255 where a leaf is drawn as geometry
uniform int levels;             // a bit each, at which it is drawn by this mesh
uniform vec3 leavesLower;       // of its first texel, relative to the eye
uniform float leafSize;
#endif
#ifdef PLACED
uniform float leftOut;    // metres: leaves nearer than that are left out, with what reaches into them
uniform vec3 leavesLower; // corner of one of them, relative to the eye
uniform float leafSize;
#endif
#ifdef SOLID
uniform float behind; // metres by which finer parts of the same go before it
uniform float margin; // metres by which it is drawn beyond its holes, as much farther away

// What is simplified does not meet what is finer: without it the sky would be seen between them.
bool isBesideHole(vec3 p) {
    for (int n = 0; n < 6; n++) {
        vec3 side = vec3(0.0);
        side[n >> 1] = (n & 1) == 0 ? margin : -margin;
        if (isHole(p + side)) return true;
    }
    return false;
}
#endif

uniform vec4 factor;  // linear light
uniform float cutoff; // alpha below it is a hole
uniform vec3 sun;
uniform float near;

out vec4 color;

void main() {
#ifdef CLIPPED
    vec3 leaf = floor((point - leavesLower) / leafSize);
    if (any(lessThan(leaf, vec3(0.0))) || any(greaterThanEqual(leaf, vec3(textureSize(leaves, 0))))) discard;
    int level = int(texelFetch(leaves, ivec3(leaf), 0).r * 255.0 + 0.5) - 1;
    if (level < 0 || ((levels >> level) & 1) == 0) discard;
#endif
#ifdef PLACED
    vec3 lower = leavesLower + floor((point - leavesLower) / leafSize) * leafSize;
    vec3 gap = max(max(lower, -(lower + leafSize)), 0.0);
    if (leftOut > 0.0 && dot(gap, gap) < leftOut * leftOut) discard;
#endif
#ifdef SOLID
    float back = behind;
    if (holeNode != 1 && !isHole(point)) {
        if (!isBesideHole(point)) discard;
        back += margin;
    }
#endif
    vec4 surface = factor;
#ifdef TEXTURED
    vec4 texel = texture(map, texturePoint);
#ifdef CUT_OUT
    // The nearest texel of the full size decides: over many samples that is the share that is covered, at any distance.
    ivec2 count = textureSize(map, 0);
    texel.a = texelFetch(map, min(ivec2(fract(texturePoint) * vec2(count)), count - 1), 0).a;
#endif
    surface *= texel;
#endif
#ifdef COLORED
    surface *= tint;
#endif
#ifdef CUT_OUT
    if (surface.a < cutoff) discard;
#endif
#ifdef UNLIT
    color = vec4(surface.rgb, 0.0);
#else
    // Which side faces the eye the surface itself decides, as in the bake: open shells and leaves show their back.
    vec3 plane = cross(dFdx(point), dFdy(point));
    float side = dot(plane, point) * dot(plane, facing);
    vec3 n = normalize(side > 0.0 ? -facing : facing);
    color = lit(surface.rgb, dot(n, sun), 1.0);
#endif
#ifdef SOLID
    gl_FragDepth = near / (1.0 / gl_FragCoord.w + back);
#else
    gl_FragDepth = near * gl_FragCoord.w;
#endif
}
