// Pixels to OpenGL's cube. With w = 1, depth and colour run evenly along a segment in
// the picture, as hairfit.render.pieces has them.
uniform vec2 size;
uniform vec2 range;  // depths of the nearest and the farthest hair
vec4 place(vec2 pixel, float depth) {
    float z = 2.0 * (depth - range.x) / (range.y - range.x) - 1.0;
    return vec4(2.0 * pixel / size - 1.0, z, 1.0);
}
