#include "compute.glsl"
#include "walk.glsl"
#include "occupied.glsl"
// Which slabs of which texels hold hair.
layout(std430, binding = 0) readonly buffer Points { vec4 point[]; };
layout(std430, binding = 1) readonly buffer Seen { vec4 seen[]; };
layout(std430, binding = 5) buffer Masks { uint mask[]; };
uniform ivec2 size;
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count || point[i].w <= 0.0) return;
    vec4 a = seen[i], b = seen[i + 1];
    if (a.w <= 0.0 || b.w <= 0.0) return;
    vec2 d = b.xy - a.xy, part = inside(a.xy, d, vec2(size));
    if (part.x >= part.y) return;
    float deeper = b.z - a.z;
    Walk w = begin_walk(a.xy, d, part, size);
    for (bool more = true; more;) {
        more = w.left > 0;
        if (w.to > w.from) {
            int s = slab_at(place_of(a.z + w.from * deeper));
            int t = slab_at(place_of(a.z + w.to * deeper));
            int first = min(s, t), last = max(s, t);
            int texel = w.pixel.y * size.x + w.pixel.x;
            for (int word = first / 32; word <= last / 32; word++) {
                uint bits = below(last + 1, word) & ~below(first, word);
                atomicOr(mask[WORDS * texel + word], bits);
            }
        }
        if (more) next_pixel(w);
    }
}
