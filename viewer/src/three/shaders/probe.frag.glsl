// Single samples of the frame, from one on: near / distance, as the bytes of a float.

uniform highp sampler2D frameDepth;
uniform ivec2 first;

out vec4 bytes;

void main() {
    uint bits = floatBitsToUint(texelFetch(frameDepth, first + ivec2(gl_FragCoord.xy), 0).r);
    bytes = vec4(uvec4(bits, bits >> 8, bits >> 16, bits >> 24) & 255u) / 255.0;
}
