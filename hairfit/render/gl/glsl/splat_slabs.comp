#include "compute.glsl"
#include "walk.glsl"
#include "slabs.glsl"
// Opacity of every segment, added in one pass to all slabs of all texels [table 6-1].
layout(std430, binding = 0) readonly buffer Points { vec4 point[]; };
layout(std430, binding = 1) readonly buffer Seen { vec4 seen[]; };
layout(std430, binding = 2) buffer Cells { uint cell[]; };
uniform ivec2 size;
uniform float unit;
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    float hair = point[i].w;  // width of the segment to the next vertex, 0 at a tip
    if (hair <= 0.0) return;
    vec4 a = seen[i], b = seen[i + 1];
    if (a.w <= 0.0 || b.w <= 0.0) return;
    vec2 d = b.xy - a.xy, part = inside(a.xy, d, vec2(size));
    if (part.x >= part.y) return;
    float total = length(d) * hair * 0.5 * (a.w + b.w) * unit;
    float deeper = b.z - a.z;
    Walk w = begin_walk(a.xy, d, part, size);
    int slab = slab_of(a.z + w.from * deeper);
    for (bool more = true; more;) {
        more = w.left > 0;
        float from = w.from;
        int goal = slab_of(a.z + w.to * deeper);
        int place = (w.pixel.y * slabs) * size.x + w.pixel.x;
        while (true) {
            float to = w.to;
            if (slab != goal) {
                float border = depth_of(goal > slab ? slab + 1 : slab);
                to = clamp((border - a.z) / deeper, from, w.to);
            }
            uint amount = uint(total * (to - from) + 0.5);
            if (amount > 0u) atomicAdd(cell[place + slab * size.x], amount);
            from = to;
            if (slab == goal) break;
            slab += goal > slab ? 1 : -1;
        }
        if (more) next_pixel(w);
    }
}
