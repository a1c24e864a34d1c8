#include "compute.glsl"
#include "lights.glsl"
// What every vertex of hair sends to the eye: ambient + shares of the lights, each with
// the local shading of section 5.4.
layout(std430, binding = 0) readonly buffer Points { vec4 point[]; };
layout(std430, binding = 5) readonly buffer Tint { vec4 tint[]; };  // and brightness
layout(std430, binding = 6) writeonly buffer Colour { vec4 colour[]; };
uniform bool tabled;
uniform sampler3D phase;  // azimuth, inclination of the light, inclination of the eye
uniform vec3 eye;
uniform vec3 ambient;
uniform float diffuse;
uniform vec3 specular;
uniform float coloured;  // share of its own colour in a highlight
uniform float shininess;
uniform uint stride;     // from the shares of one light to those of the next
const float PI = 3.14159265;
// The three angles of 5.5.4, as hairfit.render.phase.phase_angles.
vec3 scattered(vec3 tangent, vec3 light, vec3 to_eye) {
    float tl = clamp(dot(tangent, light), -1.0, 1.0);
    float tv = clamp(dot(tangent, to_eye), -1.0, 1.0);
    vec3 l = light - tl * tangent, v = to_eye - tv * tangent;
    float both = length(l) * length(v);
    float phi = both > 1e-9 ? acos(clamp(dot(l, v) / both, -1.0, 1.0)) : 0.0;
    return texture(phase, vec3(phi, asin(tl) + 0.5 * PI, asin(tv) + 0.5 * PI) / PI).rgb;
}
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    vec3 p = point[i].xyz, own = tint[i].rgb;
    vec3 total = ambient * own * sky;
    bool root = i == 0u || point[i - 1u].w <= 0.0, tip = point[i].w <= 0.0;
    vec3 along = point[tip ? i : i + 1u].xyz - point[root ? i : i - 1u].xyz;
    vec3 tangent = along / max(length(along), 1e-12), to_eye = normalize(eye - p);
    float tv = dot(tangent, to_eye), sine_eye = sqrt(max(1.0 - tv * tv, 0.0));
    for (int k = 0; k < lights; k++) {
        uint at = uint(k) * stride + i;
        vec3 way = to_light(k, p);
        float tl = dot(tangent, way), sine = sqrt(max(1.0 - tl * tl, 0.0));
        vec3 sent = diffuse * own * sine;
        if (tabled) {
            sent += tint[i].a * scattered(tangent, way, to_eye);
        } else {
            // Kajiya and Kay (5-7) to (5-11), as hairfit.render.shading.kajiya_kay.
            float mirror = pow(max(sine * sine_eye - tl * tv, 1e-9), shininess);
            sent += specular * mix(vec3(1.0), own, coloured) * mirror;
        }
        total += sent * arriving(k, p, at);
    }
    colour[i] = vec4(total, 1.0);
}
