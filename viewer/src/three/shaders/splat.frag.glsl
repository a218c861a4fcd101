// The footprint of a splat. Depth is near / d: floats then resolve all distances alike.

uniform float near;

flat in vec4 centre;
flat in vec3 conic;
flat in vec2 slope;
flat in vec4 radiance;

out vec4 color;

void main() {
    float d = centre.z;
    if (centre.w > 0.5) {
        vec2 q = gl_FragCoord.xy - centre.xy;
        bool outside = dot(conic, vec3(q.x * q.x, q.x * q.y, q.y * q.y)) > 0.5;
        if (!outside) d = max(d + dot(slope, q), 0.5 * d);
        else if (floor(gl_FragCoord.xy) != floor(centre.xy)) discard;
    }
    gl_FragDepth = near / max(d, near);
    color = radiance;
}
