#include "compute.glsl"
#include "walk.glsl"
// Every piece of hair in every pixel, in a list of the pixel. What a piece covers is the
// length of its middle line in the pixel times its width; wide hair is drawn as several
// thin ones side by side.
layout(std430, binding = 0) readonly buffer Points { vec4 point[]; };
layout(std430, binding = 1) readonly buffer Seen { vec4 seen[]; };
layout(std430, binding = 2) buffer Heads { uint head[]; };
layout(std430, binding = 3) writeonly buffer Records { uvec4 record[]; };
layout(std430, binding = 4) buffer Counter { uint used; };
layout(std430, binding = 6) readonly buffer Colour { vec4 colour[]; };
uniform uint capacity;
uniform ivec2 size;
uniform int strips;
uniform float alpha;
uniform sampler2D solid;  // depth of what is not hair, in SAMPLES x SAMPLES a pixel
float unhidden(ivec2 pixel, float depth) {
    float seen_share = 0.0;
    for (int y = 0; y < SAMPLES; y++) {
        for (int x = 0; x < SAMPLES; x++) {
            float before = texelFetch(solid, pixel * SAMPLES + ivec2(x, y), 0).x;
            seen_share += depth < before ? 1.0 : 0.0;
        }
    }
    return seen_share / float(SAMPLES * SAMPLES);
}
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    float hair = point[i].w;
    if (hair <= 0.0) return;
    vec4 a = seen[i], b = seen[i + 1];
    if (a.w <= 0.0 || b.w <= 0.0) return;
    vec2 d = b.xy - a.xy;
    float long_px = length(d);
    if (long_px <= 0.0) return;
    float wide_px = hair * 0.5 * (a.w + b.w);
    vec2 across = wide_px * vec2(-d.y, d.x) / long_px;
    float total = long_px * wide_px / float(strips);
    vec4 ca = colour[i], cb = colour[i + 1];
    for (int j = 0; j < strips; j++) {
        vec2 start = a.xy + ((float(j) + 0.5) / float(strips) - 0.5) * across;
        vec2 part = inside(start, d, vec2(size));
        if (part.x >= part.y) continue;
        Walk w = begin_walk(start, d, part, size);
        for (bool more = true; more;) {
            more = w.left > 0;
            float t = 0.5 * (w.from + w.to), depth = mix(a.z, b.z, t);
            float area = min(total * (w.to - w.from), 1.0) * alpha;
            if (area > 1e-5) area *= unhidden(w.pixel, depth);
            if (area > 1e-5) {
                vec4 c = mix(ca, cb, t);
                uint slot = atomicAdd(used, 1u);
                if (slot < capacity) {
                    int at = w.pixel.y * size.x + w.pixel.x;
                    uint last = packHalf2x16(vec2(c.b, area * c.a));
                    uvec3 own = uvec3(floatBitsToUint(depth), packHalf2x16(c.rg), last);
                    record[slot] = uvec4(atomicExchange(head[at], slot + 1u), own);
                }
            }
            if (more) next_pixel(w);
        }
    }
}
