// Light (spec/drawing.md, Light). All in linear light.

uniform vec3 ambientLight;
uniform vec3 sunLight;

vec3 linearFromSrgb(vec3 c) {
    return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c));
}

// cosine: n . sun of the mean normal's direction; len: its length, 1 for a flat surface.
float lambert(float cosine, float len) {
    float mu = len * cosine;
    if (len <= 0.5) return 0.25 + 0.5 * mu;
    float spread = (1.0 - len) * (0.36 + 0.28 * len);
    return 0.5 * (mu + sqrt(mu * mu + spread * max(0.0, 1.0 - cosine * cosine)));
}

vec3 lit(vec3 albedo, float cosine, float len) {
    return min(albedo * (ambientLight + sunLight * lambert(cosine, len)), 1.0);
}
