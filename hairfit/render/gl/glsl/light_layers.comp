#include "compute.glsl"
#include "occupied.glsl"
#include "taps.glsl"
layout(std430, binding = 2) readonly buffer Cells { uint cell[]; };
layout(std430, binding = 5) readonly buffer Masks { uint mask[]; };
uniform float unit;

float opacity(ivec2 texel, float depth) {
    int at = texel.y * size.x + texel.x;
    uvec3 held = uvec3(mask[3 * at], mask[3 * at + 1], mask[3 * at + 2]);
    float place = place_of(depth);
    int slab = slab_at(place), rank = rank_of(held, slab);
    bool own = rank_of(held, slab + 1) > rank;
    int last = own ? rank : rank - 1;
    if (last < 0) return 0.0;
    int number = count_bits(held), layer = layer_of_rank(last, number);
    int begin = first_rank(layer, number), end = first_rank(layer + 1, number);
    float reached = float(rank) + (own ? clamp(place - float(slab), 0.0, 1.0) : 0.0);
    float part = clamp((reached - float(begin)) / float(max(end - begin, 1)), 0.0, 1.0);
    int row = (texel.y * slabs + layer) * size.x + texel.x;
    float before = layer == 0 ? 0.0 : float(cell[row - size.x]);
    return mix(before, float(cell[row]), part) / unit;
}
