// A clear sky that follows the sun (spec/drawing.md, Sky); its colours come from sky.ts.

uniform vec3 sunWay;   // unit vector towards the sun
uniform vec3 zenith;   // linear light, as the next three
uniform vec3 towards;  // at the horizon below the sun
uniform vec3 away;     // at the horizon opposite it
uniform vec3 sunlight;

vec3 withGlow(vec3 color, float cosine) {
    float glow = 0.15 * exp(-12.0 * (1.0 - cosine)) + 0.5 * exp(-300.0 * (1.0 - cosine));
    return min(color + glow * sunlight, 1.0);
}

vec3 plainHorizon(float cosine) {
    return mix(away, towards, 0.5 + 0.5 * cosine);
}

vec3 horizonIn(vec3 way) {
    float cosine = dot(way, sunWay);
    return withGlow(plainHorizon(cosine), cosine);
}

vec3 skyIn(vec3 way) {
    float cosine = dot(way, sunWay);
    vec3 color = mix(zenith, plainHorizon(cosine), exp(-5.0 * max(way.z, 0.0)));
    float disc = way.z > 0.0 ? smoothstep(0.99996192, 0.99998134, cosine) : 0.0;
    return min(withGlow(color, cosine) + 2.0 * disc * sunlight, 1.0);
}
