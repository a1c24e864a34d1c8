#version 330
in vec4 shade;
in float depth;
uniform bool limited;
uniform int samples;
uniform sampler2D limit;  // depth of the background, a pixel each
layout(location = 0) out vec4 colour;
layout(location = 1) out vec4 metres;
void main() {
    if (limited && depth > texelFetch(limit, ivec2(gl_FragCoord.xy) / samples, 0).x) {
        discard;
    }
    colour = shade;
    metres = vec4(depth);
}
