#version 330
#include "place.glsl"
// A segment as a line one pixel wide; none between a tip and the next root.
layout(lines) in;
layout(line_strip, max_vertices = 2) out;
in vec4 seen[];
in float hair[];
out float depth;
#if COLOURED == 1
in vec3 own[];
out vec3 shade;
#else
uniform vec2 slab;        // depths at which slabs of this drawing begin and end
flat out float value;     // share of a pixel that each fragment stands for
flat out float deep;      // metres of depth that a fragment spans
flat out vec2 ends;       // depths of the segment's nearer and farther end
#endif
void main() {
    vec4 a = seen[0], b = seen[1];
    if (hair[0] <= 0.0 || a.w <= 0.0 || b.w <= 0.0) return;
#if COLOURED == 0
    vec2 z = vec2(min(a.z, b.z), max(a.z, b.z));
    if (z.y + THINNEST < slab.x || z.x > slab.y) return;
    vec2 d = b.xy - a.xy;
    float fragments = max(abs(d.x), abs(d.y));
    if (fragments <= 0.0) return;
    float each = hair[0] * 0.5 * (a.w + b.w) * length(d) / fragments;
#endif
    for (int k = 0; k < 2; k++) {
        gl_Position = place(seen[k].xy, seen[k].z);
        depth = seen[k].z;
#if COLOURED == 1
        shade = own[k];
#else
        value = each;
        deep = (z.y - z.x) / fragments;
        ends = z;
#endif
        EmitVertex();
    }
    EndPrimitive();
}
