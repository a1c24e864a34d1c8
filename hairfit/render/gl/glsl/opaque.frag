#version 330
// Hair at a sample, if what is not hair is behind it.
in float depth;
in vec3 shade;
uniform sampler2D metres;
out vec4 colour;
void main() {
    if (depth >= texelFetch(metres, ivec2(gl_FragCoord.xy), 0).x) discard;
    colour = vec4(shade, 1.0);
}
