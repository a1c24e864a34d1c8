#version 330
#include "before.glsl"
// Four slabs a target, all in one drawing.
uniform vec4 begin[TARGETS];
uniform vec4 end[TARGETS];
layout(location = 0) out vec4 added[TARGETS];
void main() {
    for (int k = 0; k < TARGETS; k++) added[k] = before(end[k]) - before(begin[k]);
}
