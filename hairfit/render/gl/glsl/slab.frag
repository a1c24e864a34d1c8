#version 330
#include "before.glsl"
// What one slab holds, added to what is there [table 6-1, line 10].
uniform vec2 slab;
out float added;
void main() {
    vec4 both = before(slab.xyxy);
    added = both.y - both.x;
}
