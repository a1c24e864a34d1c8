// Layers where a texel has hair, as hairfit.render.opacity_occupied has them: a bit for
// each of SLABS thin slabs, and a layer for each slab that is occupied, or for several.
const int SLABS = 96, WORDS = 3;
uniform int slabs;  // layers of a texel
uniform vec2 between;  // depths of the first and the last hair
float place_of(float depth) {
    return (depth - between.x) / (between.y - between.x) * float(SLABS);
}
int slab_at(float place) {
    return clamp(int(floor(place)), 0, SLABS - 1);
}
int count_bits(uvec3 mask) {
    return bitCount(mask.x) + bitCount(mask.y) + bitCount(mask.z);
}
uint below(int slab, int word) {  // bits of a word that are before a slab
    int bits = clamp(slab - 32 * word, 0, 32);
    return bits == 32 ? 0xffffffffu : (1u << bits) - 1u;
}
int rank_of(uvec3 mask, int slab) {
    return count_bits(mask & uvec3(below(slab, 0), below(slab, 1), below(slab, 2)));
}
int layer_of_rank(int rank, int number) {
    int single = slabs / 2;
    if (number <= slabs || rank < single) return rank;
    return single + (rank - single) * (slabs - single) / max(number - single, 1);
}
int first_rank(int layer, int number) {
    int single = slabs / 2, wide = slabs - single;
    if (number <= slabs || layer < single) return layer;
    return single + ((layer - single) * (number - single) + wide - 1) / wide;
}
