// A picture in linear light, and its depth, into the scene.

uniform highp sampler2D picture; // times alpha
uniform highp sampler2D pictureDepth;
uniform float near;
uniform vec2 depthOf;

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 found = texelFetch(picture, at, 0);
    if (found.a == 0.0) discard;
    gl_FragColor = vec4(found.rgb / found.a, found.a);
    #include <colorspace_fragment>
    gl_FragColor.rgb *= gl_FragColor.a;
    gl_FragDepth = windowDepth(texelFetch(pictureDepth, at, 0).r, near, depthOf);
}
