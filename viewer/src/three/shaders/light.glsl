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

// Mean normal of loose surfaces as the eye at -c sees it; the view's camera looks along z. Leaves that face everywhere,
// as seen, have a mean two thirds long that faces whoever looks; the rest, as if of one flat surface, shows its side.
vec3 seenFromEye(vec3 mean, vec3 c) {
    vec3 eye = -normalize(c);
    float halved = 1.0 + mean.z * 2.0 / 3.0;
    float root = sqrt(max(0.0, halved * halved - (1.0 - dot(mean, mean)) * 5.0 / 9.0));
    float around = min(2.0 / 3.0 * min(1.0, 1.8 * (halved - root)), -mean.z);
    vec3 rest = mean + vec3(0.0, 0.0, around);
    return (dot(rest, eye) < 0.0 ? -rest : rest) + around * eye;
}

// Radiance, and as alpha how squarely the sun shines on it: what a shadow will take away (resolve.frag.glsl).
vec4 lit(vec3 albedo, float cosine, float len) {
    float share = lambert(cosine, len);
    return vec4(min(albedo * (ambientLight + sunLight * share), 1.0), share);
}
