// Averages the larger frame down by a box filter in linear light, over the sky or over what the scene holds already.

uniform highp sampler2D frame;
uniform highp sampler2D frameDepth;
uniform int samples;   // a side
uniform float near;    // of the camera the frame was drawn with
uniform vec4 sky;      // linear light; alpha 0: none
uniform vec2 depthOf;  // third and fourth number of the projection's depth row

void main() {
    ivec2 corner = ivec2(gl_FragCoord.xy) * samples;
    vec4 sum = vec4(0.0);
    float nearest = 0.0;
    for (int j = 0; j < samples; j++) {
        for (int i = 0; i < samples; i++) {
            ivec2 at = corner + ivec2(i, j);
            sum += texelFetch(frame, at, 0);
            nearest = max(nearest, texelFetch(frameDepth, at, 0).r);
        }
    }
    sum /= float(samples * samples);
    if (sky.a > 0.0) {
        gl_FragColor = vec4(sum.rgb + (1.0 - sum.a) * sky.rgb, 1.0);
    } else {
        if (sum.a == 0.0) discard;
        gl_FragColor = vec4(sum.rgb / sum.a, sum.a);
    }
    #include <colorspace_fragment>
    gl_FragColor.rgb *= gl_FragColor.a;
    // depth = near / d, so 1 / d = depth / near.
    float ndc = -depthOf.x + depthOf.y * nearest / near;
    gl_FragDepth = nearest > 0.0 ? clamp(0.5 * ndc + 0.5, 0.0, 1.0) : 1.0;
}
