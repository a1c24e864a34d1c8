// Where opacity maps lie: depth of slice k, and the slab that holds a depth.
layout(std430, binding = 4) readonly buffer Slices { float slice[]; };
uniform int slabs;
float depth_of(int k) {
    float thick = (slice[slabs] - slice[0]) / float(slabs);
    return EVEN == 1 ? slice[0] + float(k) * thick : slice[k];
}
int slab_of(float depth) {
    if (EVEN == 1) {
        float s = (depth - slice[0]) / (slice[slabs] - slice[0]) * float(slabs);
        return clamp(int(floor(s)), 0, slabs - 1);
    }
    int low = 0, high = slabs;
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if (slice[middle] <= depth) low = middle; else high = middle;
    }
    return low;
}
