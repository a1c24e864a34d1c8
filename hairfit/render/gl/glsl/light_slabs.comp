#include "compute.glsl"
#include "slabs.glsl"
#include "taps.glsl"
layout(std430, binding = 2) readonly buffer Cells { uint cell[]; };
uniform float unit;

float at_slice(ivec2 texel, int k) {  // opacity down to slice k
    if (k <= 0) return 0.0;
    k = min(k, slabs);
    return float(cell[(texel.y * slabs + k - 1) * size.x + texel.x]) / unit;
}

#include "hermite.glsl"

float opacity(ivec2 texel, float depth) {
    int k = slab_of(depth);
    float low = depth_of(k), high = depth_of(k + 1);
    float t = clamp((depth - low) / (high - low), 0.0, 1.0);
    float before = at_slice(texel, k), after = at_slice(texel, k + 1);
    if (CUBIC == 0) return mix(before, after, t);
    float thick = high - low;
    float slope = (after - before) / thick;
    // The neighbour that an end slab lacks is like the slab itself.
    float above = thick, below = thick, earlier = slope, later = slope;
    if (k > 0) {
        above = low - depth_of(k - 1);
        earlier = (before - at_slice(texel, k - 1)) / above;
    }
    if (k + 1 < slabs) {
        below = depth_of(k + 2) - high;
        later = (at_slice(texel, k + 2) - after) / below;
    }
    float first = limited(earlier, slope, above, thick);
    float last = limited(slope, later, thick, below);
    return hermite(before, after, first * thick, last * thick, t);
}
