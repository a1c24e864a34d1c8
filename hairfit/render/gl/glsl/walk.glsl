// The walk of a segment through the pixels that it crosses [Amanatides and Woo 1987].
struct Walk {
    ivec2 pixel;   // where it is
    float from;    // parameter at which it came into the pixel
    float to;      // parameter at which it leaves
    int left;      // pixels yet to come
    ivec2 turn;    // how a border changes the pixel
    vec2 border;   // parameters of the next borders
    vec2 every;    // parameters between borders
    float last;    // parameter of the end
};
// The part of the segment inside the picture, as parameters; none if x > y.
vec2 inside(vec2 a, vec2 d, vec2 size) {
    vec2 low = vec2(0.0), high = vec2(1.0);
    for (int k = 0; k < 2; k++) {
        if (d[k] == 0.0) {
            if (a[k] < 0.0 || a[k] >= size[k]) high[k] = -1.0;
        } else {
            float s = -a[k] / d[k], t = (size[k] - a[k]) / d[k];
            low[k] = max(low[k], min(s, t));
            high[k] = min(high[k], max(s, t));
        }
    }
    return vec2(max(low.x, low.y), min(high.x, high.y));
}
Walk begin_walk(vec2 a, vec2 d, vec2 part, ivec2 size) {
    Walk w;
    vec2 p = a + part.x * d, q = a + part.y * d;
    w.pixel = clamp(ivec2(floor(p)), ivec2(0), size - 1);
    ivec2 goal = clamp(ivec2(floor(q)), ivec2(0), size - 1);
    w.turn = ivec2(sign(d));
    ivec2 way = abs(goal - w.pixel);
    w.left = way.x + way.y;
    w.every = 1.0 / max(abs(d), vec2(1e-20));
    vec2 rest = mix(p - vec2(w.pixel), vec2(w.pixel + 1) - p, greaterThan(d, vec2(0.0)));
    w.border = part.x + max(rest, 0.0) * w.every;
    w.from = part.x;
    w.last = part.y;
    w.to = w.left == 0 ? w.last : min(min(w.border.x, w.border.y), w.last);
    return w;
}
void next_pixel(inout Walk w) {
    if (w.border.x <= w.border.y) {
        w.pixel.x += w.turn.x;
        w.border.x += w.every.x;
    } else {
        w.pixel.y += w.turn.y;
        w.border.y += w.every.y;
    }
    w.left--;
    w.from = w.to;
    w.to = w.left == 0 ? w.last : min(min(w.border.x, w.border.y), w.last);
}
