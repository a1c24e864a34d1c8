// What a fragment of hair puts before depths: all, nothing or, across a border, a part.
in float depth;
flat in float value;
flat in float deep;
flat in vec2 ends;
vec4 before(vec4 border) {
    float middle = clamp(depth, ends.x, ends.y);
    float low = max(middle - 0.5 * deep, ends.x), high = min(middle + 0.5 * deep, ends.y);
    return value * clamp((border - low) / max(high - low, THINNEST), 0.0, 1.0);
}
