// What was shown before, where it shows the same surface, goes over into what is shown now.

uniform highp sampler2D past;       // linear light, times alpha
uniform highp sampler2D pastDepth;  // its near / d, 0 where there was nothing
uniform highp sampler2D stillDepth; // of the frame without what moves
uniform float weight;   // of the new picture

// Distances that differ by less are of one surface: less follows canopies badly, more drags what is behind along.
const float SAME_SURFACE = 0.04;

// The past picture between its pixels by cubic splines (Catmull-Rom): by straight lines, a picture that moves on and on is blurred more
// and more. Within what the four pixels around have, so that nothing rings.
vec4 pastAt(vec2 place, vec2 size) {
    vec2 first = floor(place - 0.5) + 0.5;
    vec2 f = place - first;
    vec2 w0 = f * (-0.5 + f * (1.0 - 0.5 * f));
    vec2 w1 = 1.0 + f * f * (1.5 * f - 2.5);
    vec2 w3 = f * f * (0.5 * f - 0.5);
    vec2 w2 = 1.0 - w0 - w1 - w3;
    vec2 inner = w1 + w2; // both middle pixels by one look-up between them
    vec2 at0 = (first - 1.0) / size;
    vec2 at1 = (first + w2 / inner) / size;
    vec2 at3 = (first + 2.0) / size;
    vec4 sum = texture(past, at1) * inner.x * inner.y
        + texture(past, vec2(at0.x, at1.y)) * w0.x * inner.y + texture(past, vec2(at3.x, at1.y)) * w3.x * inner.y
        + texture(past, vec2(at1.x, at0.y)) * inner.x * w0.y + texture(past, vec2(at1.x, at3.y)) * inner.x * w3.y;
    float corners = (w0.x + w3.x) * (w0.y + w3.y);
    vec4 found = sum / (1.0 - corners);
    ivec2 corner = ivec2(first);
    ivec2 last = ivec2(size) - 1;
    vec4 a = texelFetch(past, clamp(corner, ivec2(0), last), 0);
    vec4 b = texelFetch(past, clamp(corner + ivec2(1, 0), ivec2(0), last), 0);
    vec4 c = texelFetch(past, clamp(corner + ivec2(0, 1), ivec2(0), last), 0);
    vec4 d = texelFetch(past, clamp(corner + ivec2(1, 1), ivec2(0), last), 0);
    return clamp(found, min(min(a, b), min(c, d)), max(max(a, b), max(c, d)));
}

// color: times alpha; ray: through the pixel, 1 along the view axis; nearest: near / d of what it shows; low and high: of its samples.
vec4 faded(vec4 color, vec3 ray, float nearest, float near, vec4 low, vec4 high) {
    if (weight >= 1.0) return color;
    vec3 at = inPast(ray, nearest, near);
    if (at.z <= 0.0) return color;
    vec2 size = vec2(textureSize(past, 0));
    vec2 place = pastSame ? gl_FragCoord.xy : at.xy / at.z;
    if (any(lessThan(place, vec2(0.0))) || any(greaterThanEqual(place, size))) return color;
    float expected = nearest > 0.0 ? pastNear / at.z : 0.0;
    float most = SAME_SURFACE * expected;
    if (abs(texelFetch(pastDepth, ivec2(place), 0).r - expected) > most) return color;
    if (pastSame) return mix(texelFetch(past, ivec2(place), 0), color, weight);
    bool edge = false;
    ivec2 corner = ivec2(floor(place - 0.5));
    for (int n = 0; n < 4; n++) {
        ivec2 beside = clamp(corner + ivec2(n & 1, n >> 1), ivec2(0), ivec2(size) - 1);
        edge = edge || abs(texelFetch(pastDepth, beside, 0).r - expected) > most;
    }
    vec4 before = pastAt(place, size);
    // Where another surface begins, its colour would be drawn along: only as much of the past as the samples leave room for.
    return mix(edge ? clamp(before, low, high) : before, color, weight);
}
