#include "compute.glsl"
#include "walk.glsl"
#include "occupied.glsl"
layout(std430, binding = 0) readonly buffer Points { vec4 point[]; };
layout(std430, binding = 1) readonly buffer Seen { vec4 seen[]; };
layout(std430, binding = 2) buffer Cells { uint cell[]; };
layout(std430, binding = 5) readonly buffer Masks { uint mask[]; };
uniform ivec2 size;
uniform float unit;
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    float hair = point[i].w;
    if (hair <= 0.0) return;
    vec4 a = seen[i], b = seen[i + 1];
    if (a.w <= 0.0 || b.w <= 0.0) return;
    vec2 d = b.xy - a.xy, part = inside(a.xy, d, vec2(size));
    if (part.x >= part.y) return;
    float total = length(d) * hair * 0.5 * (a.w + b.w) * unit;
    float deeper = b.z - a.z;
    Walk w = begin_walk(a.xy, d, part, size);
    for (bool more = true; more;) {
        more = w.left > 0;
        int texel = w.pixel.y * size.x + w.pixel.x;
        uvec3 held = uvec3(mask[3 * texel], mask[3 * texel + 1], mask[3 * texel + 2]);
        int number = count_bits(held), row = w.pixel.y * slabs * size.x + w.pixel.x;
        float s = place_of(a.z + w.from * deeper), t = place_of(a.z + w.to * deeper);
        int slab = slab_at(s), goal = slab_at(t);
        float amount = total * (w.to - w.from), gone = 0.0;
        while (true) {
            float share = 1.0;
            if (slab != goal) {
                float border = float(goal > slab ? slab + 1 : slab);
                share = clamp((border - s) / (t - s), gone, 1.0);
            }
            uint added = uint(amount * (share - gone) + 0.5);
            if (added > 0u) {
                int rank = min(rank_of(held, slab), max(number - 1, 0));
                atomicAdd(cell[row + layer_of_rank(rank, number) * size.x], added);
            }
            gone = share;
            if (slab == goal) break;
            slab += goal > slab ? 1 : -1;
        }
        if (more) next_pixel(w);
    }
}
