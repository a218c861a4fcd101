// Which part of a cell a stand-in is drawn for (core/holes.ts): a walk down a table of nodes of 8 words, one an octant.

uniform highp usampler2D holes;
uniform int holeNode;     // 1: all of the cell, no walk
uniform vec3 cellLower;   // relative to the eye, world axes
uniform vec3 cellSize;
uniform int cellLevel;
uniform ivec3 axisLevels; // level from which cells no longer merge along each axis

// p: relative to the eye, world axes.
bool isHole(vec3 p) {
    vec3 lower = cellLower;
    vec3 size = cellSize;
    int node = holeNode;
    for (int level = cellLevel; node > 1 && level > 0; level--) {
        vec3 merges = vec3(lessThanEqual(ivec3(level), axisLevels));
        size *= 1.0 - 0.5 * merges;
        vec3 upper = step(lower + size, p) * merges;
        lower += upper * size;
        int place = node + int(upper.x + 2.0 * upper.y + 4.0 * upper.z);
        node = int(texelFetch(holes, ivec2(place & 1023, place >> 10), 0).r);
    }
    return node == 1;
}
