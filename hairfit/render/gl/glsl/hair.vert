#version 330
#include "view.glsl"
// A vertex of hair: where it lands, its width in metres (0 at a tip), and its colour.
in vec4 point;
out vec4 seen;
out float hair;
#if COLOURED == 1
in vec3 colour;
out vec3 own;
#endif
void main() {
    seen = see(point.xyz);
    hair = point.w;
#if COLOURED == 1
    own = colour;
#endif
}
