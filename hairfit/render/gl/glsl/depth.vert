#version 330
uniform mat4 clip_from_world;
uniform vec4 depth_row;
in vec3 position;
out float depth;
void main() {
    depth = dot(depth_row, vec4(position, 1.0));
    gl_Position = clip_from_world * vec4(position, 1.0);
}
