// Where things were in the picture that was shown before.

uniform mat3 toPast;    // from world axes, metres from the past eye, to pixels of the past picture times d, and d
uniform vec3 pastShift; // from the past eye to this one
uniform float pastNear;
uniform bool pastSame;  // from the same place

// Pixels times d, and d, of what is seen along a ray (1 along the view axis) at depth = near / d; at 0 it is infinitely far.
vec3 inPast(vec3 ray, float depth, float near) {
    return toPast * (depth > 0.0 ? ray * (near / depth) + pastShift : ray);
}
