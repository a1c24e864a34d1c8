#version 330
// The average of the samples of a pixel, times a share of many pictures.
uniform sampler2D picture;
uniform int samples;
uniform float share;
out vec4 colour;
void main() {
    ivec2 first = ivec2(gl_FragCoord.xy) * samples;
    vec4 sum = vec4(0.0);
    for (int y = 0; y < samples; y++) {
        for (int x = 0; x < samples; x++) {
            sum += texelFetch(picture, first + ivec2(x, y), 0);
        }
    }
    colour = sum * share / float(samples * samples);
}
