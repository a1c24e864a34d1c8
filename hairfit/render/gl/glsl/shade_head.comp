#include "compute.glsl"
#include "lights.glsl"
// What every vertex of the head sends to the eye: a matt surface.
layout(std430, binding = 0) readonly buffer Points { vec4 point[]; };
layout(std430, binding = 5) readonly buffer Normals { vec4 normal[]; };
layout(std430, binding = 6) writeonly buffer Colour { vec4 colour[]; };
uniform vec3 skin;
uniform vec3 eye;
uniform uint stride;
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    vec3 p = point[i].xyz, n = normal[i].xyz;
    // Meshes of artists have faces that are turned inside out.
    if (dot(n, eye - p) < 0.0) n = -n;
    vec3 total = sky * (0.75 + 0.25 * n.y);
    for (int k = 0; k < lights; k++) {
        float facing = max(dot(n, to_light(k, p)), 0.0);
        total += facing * arriving(k, p, uint(k) * stride + i);
    }
    colour[i] = vec4(skin * total, 1.0);
}
