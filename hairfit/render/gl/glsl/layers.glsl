// Layers of each texel's own, from its first to its last hair, thinner near the light.
layout(std430, binding = 5) readonly buffer Near { uint near[]; };
layout(std430, binding = 6) readonly buffer Far { uint far[]; };
uniform int layers;
uniform float origin;
const float THINNEST = 1e-6;  // metres between first and last hair
vec2 range_of(int texel) {  // depth of the first hair, and thickness of all layers
    float first = uintBitsToFloat(near[texel]), last = uintBitsToFloat(far[texel]);
    return vec2(origin + first, max(last - first, THINNEST));
}
// Layers end at squares of even steps: the light that is left, hence the error that can
// be seen, falls with depth.
float end_of(int layer, vec2 range) {
    float step = float(layer) / float(layers);
    return range.x + range.y * step * step;
}
int layer_of(float depth, vec2 range) {
    float s = sqrt(clamp((depth - range.x) / range.y, 0.0, 1.0)) * float(layers);
    return min(int(s), layers - 1);
}
