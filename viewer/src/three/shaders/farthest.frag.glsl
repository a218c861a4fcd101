// Of each square of the frame how far one sees in it, as the bytes of a float: near / distance, 0 past everything.

uniform highp sampler2D frameDepth;
uniform int texel; // pixels a side

out vec4 bytes;

void main() {
    ivec2 first = ivec2(gl_FragCoord.xy) * texel;
    ivec2 end = min(first + texel, textureSize(frameDepth, 0));
    float least = 1.0;
    for (int y = first.y; y < end.y; y++) {
        for (int x = first.x; x < end.x; x++) least = min(least, texelFetch(frameDepth, ivec2(x, y), 0).r);
    }
    uint bits = floatBitsToUint(least);
    bytes = vec4(uvec4(bits, bits >> 8, bits >> 16, bits >> 24) & 255u) / 255.0;
}
