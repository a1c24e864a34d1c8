#include "compute.glsl"
#include "layers.glsl"
#include "taps.glsl"
layout(std430, binding = 2) readonly buffer Cells { uint cell[]; };
uniform float unit;

float opacity(ivec2 texel, float depth) {
    int at = texel.y * size.x + texel.x;
    if (far[at] == 0u) return 0.0;
    vec2 range = range_of(at);
    int own = layer_of(depth, range);
    float begin = end_of(own, range), end = end_of(own + 1, range);
    int place = (texel.y * layers + own) * size.x + texel.x;
    float before = own == 0 ? 0.0 : float(cell[place - size.x]);
    float part = clamp((depth - begin) / (end - begin), 0.0, 1.0);
    return mix(before, float(cell[place]), part) / unit;
}
