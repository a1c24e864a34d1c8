#include "compute.glsl"
// Opacity between the light and the end of each slab: sums along the light.
layout(std430, binding = 2) buffer Cells { uint cell[]; };
uniform int slabs;
uniform ivec2 size;
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    uint columns = uint(size.x);
    uint at = (i / columns) * columns * uint(slabs) + i % columns;
    uint sum = 0u;
    for (int k = 0; k < slabs; k++) {
        sum += cell[at];
        cell[at] = sum;
        at += columns;
    }
}
