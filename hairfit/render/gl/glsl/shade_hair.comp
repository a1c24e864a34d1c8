#include "compute.glsl"
#include "lights.glsl"
// What every vertex of hair sends to the eye: ambient + shares of the lights, each with
// the local shading of section 5.4.
layout(std430, binding = 0) readonly buffer Points { vec4 point[]; };
layout(std430, binding = 5) readonly buffer Tint { vec4 tint[]; };
layout(std430, binding = 6) writeonly buffer Colour { vec4 colour[]; };
#if MODEL == 1
layout(std430, binding = 7) readonly buffer Scattered { vec4 scattered[]; };
#endif
uniform vec3 eye;
uniform vec3 ambient;
uniform float diffuse;
uniform vec3 specular;
uniform float coloured;  // share of its own colour in a highlight
uniform float shininess;
uniform uint stride;     // from the shares of one light to those of the next
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    vec3 p = point[i].xyz, own = tint[i].rgb;
    vec3 total = ambient * own * sky;
#if MODEL == 0
    bool root = i == 0u || point[i - 1u].w <= 0.0, tip = point[i].w <= 0.0;
    vec3 along = point[tip ? i : i + 1u].xyz - point[root ? i : i - 1u].xyz;
    vec3 tangent = along / max(length(along), 1e-12), to_eye = normalize(eye - p);
    float tv = dot(tangent, to_eye), sine_eye = sqrt(max(1.0 - tv * tv, 0.0));
#endif
    for (int k = 0; k < lights; k++) {
        uint at = uint(k) * stride + i;
#if MODEL == 1
        vec3 sent = own * scattered[at].rgb;
#else
        // Kajiya and Kay (5-7) to (5-11), as hairfit.render.shading.kajiya_kay.
        float tl = dot(tangent, to_light(k, p)), sine = sqrt(max(1.0 - tl * tl, 0.0));
        float mirror = pow(max(sine * sine_eye - tl * tv, 1e-9), shininess);
        vec3 sent = diffuse * own * sine + specular * mix(vec3(1.0), own, coloured) * mirror;
#endif
        total += sent * arriving(k, p, at);
    }
    colour[i] = vec4(total, tint[i].a);
}
