// A picture in linear light, and its depth, into the scene; blurred by the way that the camera has gone, as far as a shutter is open.

uniform highp sampler2D picture; // times alpha
uniform highp sampler2D pictureDepth;
uniform mat3 toRay;   // as for averaging
uniform float ratio;
uniform float near;
uniform vec2 depthOf;
uniform float shutter; // share of the time since the picture before

const int TAPS = 12;
const float LONGEST = 48.0; // pixels

vec4 blurred(vec4 color, float depth) {
    vec3 at = inPast(toRay * vec3(gl_FragCoord.xy * ratio, 1.0), depth, near);
    if (at.z <= 0.0) return color;
    vec2 way = (at.xy / at.z - gl_FragCoord.xy) * shutter;
    float far = length(way);
    if (far < 0.5) return color;
    way *= min(1.0, LONGEST / far);
    vec2 size = vec2(textureSize(picture, 0));
    vec4 sum = color;
    for (int n = 1; n < TAPS; n++) sum += texture(picture, (gl_FragCoord.xy + way * float(n) / float(TAPS - 1)) / size);
    return sum / float(TAPS);
}

void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 found = texelFetch(picture, at, 0);
    float depth = texelFetch(pictureDepth, at, 0).r;
    if (shutter > 0.0 && !pastSame) found = blurred(found, depth);
    if (found.a == 0.0) discard;
    gl_FragColor = vec4(found.rgb / found.a, found.a);
    #include <colorspace_fragment>
    gl_FragColor.rgb *= gl_FragColor.a;
    gl_FragDepth = windowDepth(depth, near, depthOf);
}
