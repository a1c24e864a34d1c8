#version 330
in float depth;
out vec4 metres;
void main() {
    metres = vec4(depth);
}
