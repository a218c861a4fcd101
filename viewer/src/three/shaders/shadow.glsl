// Shadows from the maps of shadows.ts. Positions are relative to the eye, world axes, metres.

uniform int shadowCount;        // maps in use, the smallest first; 0: no shadows
uniform mat4 shadowRows[4];     // columns: what gives x, y (texels) and depth of a position; middle of what is covered
uniform vec3 shadowSpheres[4];  // metres a texel, radius of what is covered, near
uniform highp sampler2D shadowMap0;
uniform highp sampler2D shadowMap1;
uniform highp sampler2D shadowMap2;
uniform highp sampler2D shadowMap3;

// Share of the sun that reaches depth d at a place of a map (texels), smoothly between its texels. Texels hold near / d.
float shownIn(highp sampler2D map, vec2 at, float d, float near) {
    vec2 corner = floor(at - 0.5);
    vec2 part = at - 0.5 - corner;
    vec4 found;
    for (int n = 0; n < 4; n++) {
        float held = texelFetch(map, ivec2(corner) + ivec2(n & 1, n >> 1), 0).r;
        found[n] = held * d <= near ? 1.0 : 0.0;
    }
    vec2 rows = mix(found.xz, found.yw, part.x);
    return mix(rows.x, rows.y, part.y);
}

float shownAt(int n, vec3 c, float slope, float footprint, vec2 jitter) {
    vec3 sphere = shadowSpheres[n];
    vec4 place = vec4(c, 1.0) * shadowRows[n];
    float d = place.z - sphere.x * (1.0 + 1.5 * slope) - footprint;
    vec2 at = place.xy / place.z + jitter;
    if (n == 0) return shownIn(shadowMap0, at, d, sphere.z);
    if (n == 1) return shownIn(shadowMap1, at, d, sphere.z);
    if (n == 2) return shownIn(shadowMap2, at, d, sphere.z);
    return shownIn(shadowMap3, at, d, sphere.z);
}

// share: how squarely the sun shines on the surface; footprint: metres by which its place may be wrong; jitter: texels.
float sunShown(vec3 c, float share, float footprint, vec2 jitter) {
    float slope = min(sqrt(max(0.0, 1.0 - share * share)) / max(share, 0.05), 4.0);
    float shown = 0.0;
    float left = 1.0;
    for (int n = 0; n < shadowCount && left > 0.0; n++) {
        // Over its outermost tenth a map gives way to the next larger one, the last to no shadows.
        float inside = left * clamp(10.0 * (1.0 - distance(c, shadowRows[n][3].xyz) / shadowSpheres[n].y), 0.0, 1.0);
        if (inside > 0.0) shown += inside * shownAt(n, c, slope, footprint, jitter);
        left -= inside;
    }
    return shown + left;
}
