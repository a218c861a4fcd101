// A scene's depth of what lies at d, from depth = near / d; depthOf: third and fourth number of the projection's depth row.

float windowDepth(float depth, float near, vec2 depthOf) {
    return depth > 0.0 ? clamp(0.5 * (depthOf.y * depth / near - depthOf.x) + 0.5, 0.0, 1.0) : 1.0;
}
