// The visibility buffer: of each pixel the triangle that the camera sees (Burns and Hunt, "The Visibility Buffer", 2013).
// Where it is seen, and what shading interpolates there, is computed when it is needed.

//@ section camera
// The frame of the camera: right and up over half the frame's width at depth 1, back, and the eye, about the centre of
// the geometry; `place` moves the film, `lens` what is in front of and behind the plane of focus.
uniform vec3 right, up, back, eye;
uniform vec2 place, lens;
uniform float aspect;
uniform ivec2 size;

// The direction, of any length, of the ray through a place of the film in pixels from the lower left.
vec3 film_ray(vec2 pixels) {
    vec2 across = (2.0 * pixels / vec2(size) - 1.0) * vec2(1.0, 1.0 / aspect) - place - lens;
    return across.x * right / dot(right, right) + across.y * up / dot(up, up) - back;
}
//@ section vertex
uniform vec2 depths;
layout(location = 0) in vec3 corner;
layout(location = 1) in uint number;  // of the triangle whose last corner this is
flat out uint triangle;
void main() {
    triangle = number;
    vec3 seen = corner - eye;
    float depth = -dot(seen, back);
    vec2 across = vec2(dot(seen, right), dot(seen, up)) + (place + lens) * depth;
    // Depths grow from the nearest to the farthest plane as 1 - near / depth does.
    float z = depths.y / (depths.y - depths.x) * (depth - depths.x);
    gl_Position = vec4(across.x, across.y * aspect, 2.0 * z - depth, depth);
}
//@ section fragment
flat in uint triangle;
layout(location = 0) out uint seen;
void main() {
#if SEE_THROUGH
    if (absent()) discard;
#endif
    seen = triangle + 1u;
}
