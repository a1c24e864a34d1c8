#version 330
#include "walk.glsl"
// What a hair covers of a pixel: the length of its middle line inside, times its width,
// as hairfit.render.pieces has it; wide hair is several thin ones side by side.
flat in vec4 line;
flat in float width;
flat in vec2 deep;
flat in vec3 first;
flat in vec3 last;
uniform int strips;
uniform float alpha;
uniform sampler2D metres;  // depth of what is not hair, in SAMPLES x SAMPLES a pixel
out vec4 colour;
float unhidden(ivec2 pixel, float depth) {
    float seen_share = 0.0;
    for (int y = 0; y < SAMPLES; y++) {
        for (int x = 0; x < SAMPLES; x++) {
            float before = texelFetch(metres, pixel * SAMPLES + ivec2(x, y), 0).x;
            seen_share += depth < before ? 1.0 : 0.0;
        }
    }
    return seen_share / float(SAMPLES * SAMPLES);
}
void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec2 a = line.xy - vec2(pixel), d = line.zw;
    float span = length(d);
    vec2 across = width * vec2(-d.y, d.x) / span;
    float share = 0.0, middle = 0.0;  // sums over strips, of parts of the segment
    for (int j = 0; j < strips; j++) {
        float beside = (float(j) + 0.5) / float(strips) - 0.5;
        vec2 part = inside(a + beside * across, d, vec2(1.0));
        float own = max(part.y - part.x, 0.0);
        share += own;
        middle += own * 0.5 * (part.x + part.y);
    }
    if (share <= 0.0) discard;
    float t = middle / share;
    float area = min(share * span * width / float(strips), 1.0) * alpha;
    area *= unhidden(pixel, mix(deep.x, deep.y, t));
    colour = area * vec4(mix(first, last, t), 1.0);
}
