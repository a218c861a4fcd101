// Normals of pixels, by their code of 6 + 6 bits: half an octahedron, towards the view's camera.

vec3 normalOf(uint code) {
    vec2 s = vec2(float(code & 63u), float((code >> 6) & 63u)) * (2.0 / 63.0) - 1.0;
    vec2 n = vec2(s.x + s.y, s.x - s.y) * 0.5;
    return normalize(vec3(n, -max(0.0, 1.0 - abs(n.x) - abs(n.y))));
}
