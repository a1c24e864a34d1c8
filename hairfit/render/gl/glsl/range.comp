#include "compute.glsl"
#include "walk.glsl"
// Depth of the first and the last hair in every texel. The bits of a positive float are
// ordered as the number is, so integers find the least and the greatest.
layout(std430, binding = 0) readonly buffer Points { vec4 point[]; };
layout(std430, binding = 1) readonly buffer Seen { vec4 seen[]; };
layout(std430, binding = 5) buffer Near { uint near[]; };
layout(std430, binding = 6) buffer Far { uint far[]; };
uniform ivec2 size;
uniform float origin;  // depth from which bits are counted
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
            float s = a.z + w.from * deeper - origin, t = a.z + w.to * deeper - origin;
            int at = w.pixel.y * size.x + w.pixel.x;
            atomicMin(near[at], floatBitsToUint(max(min(s, t), 0.0)));
            atomicMax(far[at], floatBitsToUint(max(max(s, t), 0.0)));
        }
        if (more) next_pixel(w);
    }
}
