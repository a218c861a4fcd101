// A frame as it is, with its depth.

uniform highp sampler2D frame;
uniform highp sampler2D frameDepth;

out vec4 color;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    color = texelFetch(frame, at, 0);
    gl_FragDepth = texelFetch(frameDepth, at, 0).r;
}
