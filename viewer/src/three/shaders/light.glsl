// Light (spec/drawing.md, Light). All in linear light.

uniform vec3 ambientLight;
uniform vec3 sunLight;

vec3 linearFromSrgb(vec3 c) {
    return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), step(0.04045, c));
}

// cosine: n . sun of the mean normal's direction; len: its length, 1 for a flat surface.
float lambert(float cosine, float len) {
    float mu = len * cosine;
    return 0.5 * (mu + sqrt(mu * mu + 0.25 * (1.0 - len * len)));
}

vec3 lit(vec3 albedo, float cosine, float len) {
    return min(albedo * (ambientLight + sunLight * lambert(cosine, len)), 1.0);
}
