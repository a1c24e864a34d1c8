// Lights: direction (w = 0) or place (w = 1) and colour, and what of them reaches a point.
const int MOST = 16;
uniform int lights;
uniform vec4 light_place[MOST];
uniform vec3 light_colour[MOST];
uniform vec3 kappa;
uniform vec3 sky;
layout(std430, binding = 3) readonly buffer Light { vec2 light[]; };

vec3 to_light(int k, vec3 p) {
    return normalize(light_place[k].xyz - light_place[k].w * p);
}
vec3 arriving(int k, vec3 p, uint at) {
    vec3 way = light_place[k].xyz - p;
    float fall = light_place[k].w == 0.0 ? 1.0 : 1.0 / max(dot(way, way), 1e-6);
    vec2 share = light[at];
    return light_colour[k] * fall * share.y * exp(-kappa * share.x);
}
