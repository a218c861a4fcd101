// The boxes of BlockMaps, of which the far faces are drawn: the eye may be inside. Vectors are along the world's axes, metres.

in vec3 position; // 0 or 1 along each axis
in vec4 place;    // lower corner of the cell, at the height of code 1, relative to the eye; layer of the page
in vec4 form;     // metres of a texel along x and y, from code to code, from code 1 to the highest point
in vec4 looks;    // heights that distances are told for, metres above code 1; metres by which finer parts of the same go before it
in vec4 walls;    // columns of a side; 1: walls by area; 1: tops may slope; 1: bodies may end below

uniform int texels;  // a side of a map
uniform vec3 toX;    // rows of the linear part of the projection, pixels
uniform vec3 toY;
uniform vec3 toW;    // the view axis
uniform vec2 frame;  // width and height, pixels
uniform float near;

flat out vec3 eye;   // texels along x and y from the cell's corner, metres above code 1
flat out vec4 shape;
flat out vec4 heights;
flat out vec4 walling;
flat out int layer;

void main() {
    float margin = form.x / MARGIN;
    vec3 lower = vec3(place.xy, place.z - margin);
    vec3 upper = place.xyz + vec3(form.xy * float(texels), form.w + margin);
    // Of a mirrored picture the far faces are those that are near in another.
    vec3 at = dot(cross(toX, toY), toW) > 0.0 ? vec3(1.0 - position.x, position.yz) : position;
    vec3 c = mix(lower, upper, at);
    float d = dot(toW, c);
    vec2 s = vec2(dot(toX, c), dot(toY, c));
    gl_Position = vec4(2.0 * s / frame - d, d - 2.0 * near, d);
    eye = -place.xyz / vec3(form.xy, 1.0);
    shape = form;
    heights = looks;
    walling = walls;
    layer = int(place.w);
}
