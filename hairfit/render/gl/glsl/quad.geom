#version 330
#include "place.glsl"
// A segment as a rectangle: as wide as the hair or, so that no pixel that it touches is
// missed, a little larger.
layout(lines) in;
layout(triangle_strip, max_vertices = 4) out;
in vec4 seen[];
in float hair[];
in vec3 own[];
out float depth;
out vec3 shade;
#if COVERED == 1
flat out vec4 line;    // start and step of the middle line, in pixels
flat out float width;  // in pixels
flat out vec2 deep;    // depths of both ends
flat out vec3 first;
flat out vec3 last;
#endif
void main() {
    vec4 a = seen[0], b = seen[1];
    if (hair[0] <= 0.0 || a.w <= 0.0 || b.w <= 0.0) return;
    vec2 d = b.xy - a.xy;
    float span = length(d);
    if (span <= 0.0) return;
    float wide = hair[0] * 0.5 * (a.w + b.w);
    float more = COVERED == 1 ? 0.75 : 0.0;  // half a pixel's diagonal, and a little
    vec2 along = d / span, across = (0.5 * wide + more) * vec2(-along.y, along.x);
    for (int k = 0; k < 4; k++) {
        vec2 pixel = k < 2 ? a.xy - more * along : b.xy + more * along;
        depth = seen[k / 2].z;
        shade = own[k / 2];
        gl_Position = place(pixel + (k % 2 == 0 ? across : -across), depth);
#if COVERED == 1
        line = vec4(a.xy, d);
        width = wide;
        deep = vec2(a.z, b.z);
        first = own[0];
        last = own[1];
#endif
        EmitVertex();
    }
    EndPrimitive();
}
