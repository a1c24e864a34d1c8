#version 330
uniform mat4 clip_from_world;
uniform vec4 depth_row;
in vec3 position;
in vec4 colour;
out vec4 shade;
out float depth;
void main() {
    shade = colour;
    depth = dot(depth_row, vec4(position, 1.0));
    gl_Position = clip_from_world * vec4(position, 1.0);
}
