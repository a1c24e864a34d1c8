#version 330
// A triangle that holds the whole picture.
void main() {
    vec2 corner = vec2(gl_VertexID % 2, gl_VertexID / 2);
    gl_Position = vec4(4.0 * corner - 1.0, 0.0, 1.0);
}
