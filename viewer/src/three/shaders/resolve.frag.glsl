// Averages the larger frame down by a box filter in linear light, over the sky or over what the scene holds already. What
// depends on depth alone is done here, once a sample for splats and triangles alike: shadows and haze.

uniform highp sampler2D frame;      // alpha: how squarely the sun shines on it
uniform highp sampler2D frameDepth; // near / d, 0 where there is nothing
uniform int samples;   // a side
uniform float ratio;   // as many, or less than 1: pixels of the frame for one of the picture
uniform float near;    // of the camera the frame was drawn with
uniform int skyKind;   // 0: none, 1: one colour, 2: a clear sky
uniform vec3 sky;      // linear light
uniform float haze;    // share a metre; 0: none
uniform vec2 depthOf;
uniform mat3 toRay;    // from samples to the ray through them, 1 along the view axis; world axes, metres
uniform float texel;   // metres a picture's pixel takes at distance 1
uniform vec3 ambientLight;
uniform vec3 sunLight;

vec3 shadowed(vec3 radiance, float share, vec3 ray, float d, vec2 jitter) {
    float shown = sunShown(ray * d, share, 1.5 * texel * d, jitter);
    vec3 whole = ambientLight + sunLight * share;
    return radiance * (whole - sunLight * share * (1.0 - shown)) / max(whole, 1e-6);
}

void main() {
    ivec2 corner = ivec2(floor(gl_FragCoord.xy) * ratio);
    vec3 middle = toRay * vec3(gl_FragCoord.xy * ratio, 1.0);
    vec3 way = normalize(middle);
    vec3 veil = skyKind == 2 && haze > 0.0 ? horizonIn(way) : sky;
    float dimmed = haze * length(middle) * near;
    vec3 sum = vec3(0.0);
    float count = 0.0;
    float nearest = 0.0;
#ifdef FADED
    bool moves = false;
    vec4 low = vec4(1e9);
    vec4 high = vec4(0.0);
#endif
    for (int j = 0; j < samples; j++) {
        for (int i = 0; i < samples; i++) {
            ivec2 at = corner + ivec2(i, j);
            float inverse = texelFetch(frameDepth, at, 0).r;
#ifdef FADED
            moves = moves || texelFetch(stillDepth, at, 0).r != inverse;
#endif
            if (inverse == 0.0) continue;
            vec4 found = texelFetch(frame, at, 0);
            vec3 color = found.rgb;
            if (shadowCount > 0 && found.a > 0.0) {
                vec2 jitter = ((vec2(i, j) + 0.5) / float(samples) - 0.5) * 1.5;
                color = shadowed(color, found.a, toRay * vec3(vec2(at) + 0.5, 1.0), near / inverse, jitter);
            }
            if (haze > 0.0) color = mix(veil, color, exp(-dimmed / inverse));
            sum += color;
#ifdef FADED
            low = min(low, vec4(color, 1.0));
            high = max(high, vec4(color, 1.0));
#endif
            count += 1.0;
            nearest = max(nearest, inverse);
        }
    }
    float cover = count / float(samples * samples);
    vec4 behind = skyKind > 0 ? vec4(skyKind == 2 && cover < 1.0 ? skyIn(way) : sky, 1.0) : vec4(0.0);
    vec4 color = vec4(sum / float(samples * samples), cover) + (1.0 - cover) * behind;
#ifdef FADED
    if (cover < 1.0) {
        low = min(low, behind);
        high = max(high, behind);
    }
    gl_FragColor = moves ? color : faded(color, middle, nearest, near, low, high);
    gl_FragDepth = nearest;
#else
    if (color.a == 0.0) discard;
    gl_FragColor = vec4(color.rgb / color.a, color.a);
    #include <colorspace_fragment>
    gl_FragColor.rgb *= gl_FragColor.a;
    gl_FragDepth = windowDepth(nearest, near, depthOf);
#endif
}
