#include "compute.glsl"
// The pieces of a pixel, blended from the nearest: the nearest DEEP in order, all behind
// them as one. What shines through is the picture of all that is not hair.
layout(std430, binding = 2) readonly buffer Heads { uint head[]; };
layout(std430, binding = 3) readonly buffer Records { uvec4 record[]; };
layout(std430, binding = 6) writeonly buffer Image { PIXEL image[]; };
uniform ivec2 size;
uniform float merge;  // metres of depth within which pieces are of one hair
uniform float white;  // luminance that becomes white, 0 to leave light as it is
uniform sampler2D ground;
vec4 behind(ivec2 pixel) {
    vec4 sum = vec4(0.0);
    for (int y = 0; y < SAMPLES; y++) {
        for (int x = 0; x < SAMPLES; x++) {
            sum += texelFetch(ground, pixel * SAMPLES + ivec2(x, y), 0);
        }
    }
    return sum / float(SAMPLES * SAMPLES);
}
vec3 srgb(vec3 c) {
    vec3 low = 12.92 * c, high = 1.055 * pow(max(c, vec3(1e-9)), vec3(1.0 / 2.4)) - 0.055;
    return mix(high, low, lessThanEqual(c, vec3(0.0031308)));
}
// Pieces at the same depth have an order as well: that of the list is chance.
bool is_before(uvec3 x, uvec3 y) {
    if (x.x != y.x) return x.x < y.x;
    return x.y != y.y ? x.y < y.y : x.z < y.z;
}
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    ivec2 pixel = ivec2(int(i) % size.x, int(i) / size.x);
    vec4 sum = vec4(0.0);
    float left = 1.0;
    uint at = head[i];
    if (at != 0u) {
        uvec3 nearest[DEEP];
        for (int k = 0; k < DEEP; k++) nearest[k] = uvec3(0xffffffffu, 0u, 0u);
        vec4 rest = vec4(0.0);
        float through = 1.0;
        while (at != 0u) {
            uvec4 r = record[at - 1u];
            uvec3 x = r.yzw;
            at = r.x;
            for (int k = 0; k < DEEP; k++) {
                uvec3 y = nearest[k];
                bool before = is_before(x, y);
                nearest[k] = before ? x : y;
                x = before ? y : x;
            }
            if (x.x != 0xffffffffu) {
                vec2 last = unpackHalf2x16(x.z);
                rest += last.y * vec4(unpackHalf2x16(x.y), last.x, 1.0);
                through *= 1.0 - last.y;
            }
        }
        // Strips of one hair lie side by side: what they cover adds up.
        vec4 hair = vec4(0.0);
        float start = -1e30;
        for (int k = 0; k <= DEEP; k++) {
            uvec3 x = k < DEEP ? nearest[k] : uvec3(0u);
            float depth = uintBitsToFloat(x.x);
            vec2 last = unpackHalf2x16(x.z);
            vec4 own = last.y * vec4(unpackHalf2x16(x.y), last.x, 1.0);
            if (k < DEEP && depth - start < merge) {
                hair += own;
                continue;
            }
            float covered = min(hair.a, 1.0);
            sum += left * covered * hair / max(hair.a, 1e-9);
            left *= 1.0 - covered;
            hair = own;
            start = depth;
        }
        if (rest.a > 0.0) {
            sum += left * (1.0 - through) * rest / rest.a;
            left *= through;
        }
    }
    sum += left * behind(pixel);
#if LINEAR == 1
    image[i] = sum;
#else
    vec3 c = sum.a > 0.0 ? sum.rgb / sum.a : sum.rgb;
    if (white > 0.0) {
        float light = dot(c, vec3(0.2126, 0.7152, 0.0722));
        c *= (1.0 + light / (white * white)) / (1.0 + light);
    }
    image[i] = packUnorm4x8(vec4(srgb(c), sum.a));
#endif
}
