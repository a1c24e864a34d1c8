#include "compute.glsl"
#include "view.glsl"
// Where the vertices of all strands land in a view.
layout(std430, binding = 0) readonly buffer Points { vec4 point[]; };
layout(std430, binding = 1) writeonly buffer Seen { vec4 seen[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < count) seen[i] = see(point[i].xyz);
}
