// Opacity at points, weighted over the texels around them.
#include "view.glsl"
layout(std430, binding = 0) readonly buffer Points { vec4 point[]; };
// Opacity of the hair before each point, and the share that the head lets by.
layout(std430, binding = 3) writeonly buffer Light { vec2 light[]; };
uniform ivec2 size;
// BOX: texels along the side of the filter, 1 bilinear, 3 averaged.
const int REACH = (BOX - 1) / 2;
uniform uint offset;     // where the light's shares begin
uniform bool has_head;
uniform float bias;      // metres that a point may lie behind the head's surface
uniform sampler2D head;  // depth of the head from the light

float opacity(ivec2 texel, float depth);

float hair_opacity(vec2 pixel, float depth) {
    vec2 g = pixel - 0.5;
    ivec2 corner = ivec2(floor(g));
    vec2 f = g - vec2(corner);
    float sum = 0.0;
    for (int y = -REACH; y <= REACH + 1; y++) {
        float wy = (y == -REACH ? 1.0 - f.y : y == REACH + 1 ? f.y : 1.0) / float(BOX);
        for (int x = -REACH; x <= REACH + 1; x++) {
            float wx = (x == -REACH ? 1.0 - f.x : x == REACH + 1 ? f.x : 1.0);
            ivec2 texel = clamp(corner + ivec2(x, y), ivec2(0), size - 1);
            float weight = wx * wy / float(BOX);
            sum += weight * opacity(texel, depth);
        }
    }
    return sum;
}

float past_head(vec2 pixel, float depth) {
    if (!has_head) return 1.0;
    vec2 g = pixel - 0.5;
    ivec2 corner = ivec2(floor(g));
    vec2 f = g - vec2(corner);
    float sum = 0.0;
    for (int y = 0; y < 2; y++) {
        for (int x = 0; x < 2; x++) {
            ivec2 texel = clamp(corner + ivec2(x, y), ivec2(0), size - 1);
            float weight = (x == 0 ? 1.0 - f.x : f.x) * (y == 0 ? 1.0 - f.y : f.y);
            bool lit = depth <= texelFetch(head, texel, 0).x + bias;
            sum += lit ? weight : 0.0;
        }
    }
    return sum;
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    vec4 at = see(point[i].xyz);
    vec2 share = vec2(0.0, 1.0);
    if (at.w > 0.0) share = vec2(hair_opacity(at.xy, at.z), past_head(at.xy, at.z));
    light[offset + i] = share;
}
