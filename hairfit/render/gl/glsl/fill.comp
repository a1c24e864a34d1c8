#include "compute.glsl"
layout(std430, binding = 2) writeonly buffer Cells { uvec4 cell[]; };
uniform uint value;
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < count) cell[i] = uvec4(value);
}
