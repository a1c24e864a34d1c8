// Slopes that keep a cubic monotone [Fritsch and Butland 1984], and the cubic.
float limited(float left, float right, float left_width, float right_width) {
    if (left * right <= 0.0) return 0.0;
    float total = left_width + right_width;
    float a = (left_width + total) / (3.0 * total);
    return left * right / (a * right + (1.0 - a) * left);
}
float hermite(float p, float q, float m, float n, float t) {
    float u = 1.0 - t;
    return p * (1.0 + 2.0 * t) * u * u + m * t * u * u
        + q * t * t * (3.0 - 2.0 * t) - n * t * t * u;
}
