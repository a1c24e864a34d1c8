#include "compute.glsl"
#include "walk.glsl"
#include "layers.glsl"
layout(std430, binding = 0) readonly buffer Points { vec4 point[]; };
layout(std430, binding = 1) readonly buffer Seen { vec4 seen[]; };
layout(std430, binding = 2) buffer Cells { uint cell[]; };
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
        vec2 range = range_of(texel);
        float s = a.z + w.from * deeper, t = a.z + w.to * deeper;
        int layer = layer_of(s, range), goal = layer_of(t, range);
        int place = w.pixel.y * layers * size.x + w.pixel.x;
        float amount = total * (w.to - w.from), gone = 0.0;
        while (true) {
            float share = 1.0;
            if (layer != goal) {
                float border = end_of(goal > layer ? layer + 1 : layer, range);
                share = clamp((border - s) / (t - s), gone, 1.0);
            }
            uint added = uint(amount * (share - gone) + 0.5);
            if (added > 0u) atomicAdd(cell[place + layer * size.x], added);
            gone = share;
            if (layer == goal) break;
            layer += goal > layer ? 1 : -1;
        }
        if (more) next_pixel(w);
    }
}
