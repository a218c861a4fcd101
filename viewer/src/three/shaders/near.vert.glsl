// Triangles of a cell, or of a mesh placed many times. Vectors are along the world's axes, metres.

in vec3 position;
in vec3 normal;
#ifdef TEXTURED
in vec2 uv;
out vec2 texturePoint;
#endif
#ifdef COLORED
in vec4 color;
out vec4 tint;
#endif
#ifdef INSTANCED
in mat4 instanceMatrix;
#endif

uniform mat4 modelMatrix; // from the frame of the positions to the eye: only a shift, but of what moves
uniform vec3 toX;         // rows of the linear part of the projection, pixels
uniform vec3 toY;
uniform vec3 toW;         // the view axis
uniform vec2 frame;       // width and height, pixels
uniform float near;

out vec3 point;           // relative to the eye
out vec3 facing;

void main() {
#if defined(INSTANCED) || defined(MOVING)
#ifdef INSTANCED
    mat3 m = mat3(instanceMatrix);
    vec3 c = m * position + instanceMatrix[3].xyz;
#else
    mat3 m = mat3(modelMatrix);
    vec3 c = m * position;
#endif
    // Normals go with the cofactors, which keep their sense under mirroring too.
    mat3 cofactors = mat3(cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1]));
    facing = cofactors * normal * sign(dot(m[0], cofactors[0]));
#else
    vec3 c = position;
    facing = normal;
#endif
    point = c + modelMatrix[3].xyz;
#ifdef TEXTURED
    texturePoint = uv;
#endif
#ifdef COLORED
    tint = color;
#endif
    float d = dot(toW, point);
    vec2 s = vec2(dot(toX, point), dot(toY, point));
    gl_Position = vec4(2.0 * s / frame - d, d - 2.0 * near, d);
}
