"""The programs that draw hair and heads on the graphics card."""

HAIR_VERTEX = """
#version 330
uniform mat4 clip_from_world;
in vec3 position;
in vec3 direction;
in vec2 light;
in float brightness;
out vec3 place;
out vec3 tangent;
out vec3 shade;
void main() {
    place = position;
    tangent = direction;
    shade = vec3(light, brightness);
    gl_Position = clip_from_world * vec4(position, 1.0);
}
"""

# A line becomes a strip of its width, as many drivers draw lines of one pixel only.
HAIR_GEOMETRY = """
#version 330
layout(lines) in;
layout(triangle_strip, max_vertices = 4) out;
uniform vec2 size;
uniform float half_width;
in vec3 place[];
in vec3 tangent[];
in vec3 shade[];
out vec3 p;
out vec3 t;
out vec3 s;
out float side;
void main() {
    vec4 a = gl_in[0].gl_Position, b = gl_in[1].gl_Position;
    if (a.w <= 0.0 || b.w <= 0.0) return;
    vec2 along = (b.xy / b.w - a.xy / a.w) * size;
    float size_px = length(along);
    vec2 across = size_px > 1e-6 ? vec2(-along.y, along.x) / size_px : vec2(1, 0);
    vec2 reach = 2.0 * half_width * across / size;
    for (int i = 0; i < 2; i++) {
        for (int j = -1; j <= 1; j += 2) {
            vec4 c = gl_in[i].gl_Position;
            p = place[i];
            t = tangent[i];
            s = shade[i];
            side = float(j);
            gl_Position = c + vec4(float(j) * reach * c.w, 0.0, 0.0);
            EmitVertex();
        }
    }
    EndPrimitive();
}
"""

# Kajiya and Kay's model, as in `hairfit.render.kajiya_kay`, for two lights.
HAIR_FRAGMENT = """
#version 330
uniform vec3 eye;
uniform vec3 to_light[2];
uniform vec3 colour;
in vec3 p;
in vec3 t;
in vec3 s;
in float side;
out vec4 fragment;
void main() {
    const float strength[2] = float[2](1.5, 0.9);
    vec3 tangent = normalize(t), to_eye = normalize(eye - p);
    float tv = dot(tangent, to_eye), sine_eye = sqrt(max(1.0 - tv * tv, 0.0));
    vec3 total = 0.35 * colour * (0.3 + 0.7 * mix(s.x, s.y, 0.4));
    for (int k = 0; k < 2; k++) {
        float tl = dot(tangent, to_light[k]);
        float sine_light = sqrt(max(1.0 - tl * tl, 0.0));
        float mirror = pow(max(sine_light * sine_eye - tl * tv, 0.0), 24.0);
        vec3 lit = 0.65 * colour * sine_light + (0.08 + 0.5 * colour) * mirror;
        total += strength[k] * s[k] * lit;
    }
    // A strand is round: its sides turn away.
    float across = 0.6 + 0.4 * sqrt(max(1.0 - side * side, 0.0));
    fragment = vec4(total * s.z * across, 1.0);
}
"""

HEAD_VERTEX = """
#version 330
uniform mat4 clip_from_world;
in vec3 position;
in vec3 direction;
in vec2 light;
in float brightness;
out vec3 normal;
out vec3 place;
out vec2 share;
out float bright;
void main() {
    normal = direction;
    place = position;
    share = light;
    bright = brightness;
    gl_Position = clip_from_world * vec4(position, 1.0);
}
"""

HEAD_FRAGMENT = """
#version 330
uniform vec3 eye;
uniform vec3 to_light[2];
uniform vec3 colour;
in vec3 normal;
in vec3 place;
in vec2 share;
in float bright;
out vec4 fragment;
void main() {
    vec3 n = normalize(normal), to_eye = normalize(eye - place);
    // Light from the eye's side keeps a head round where the lamps do not reach.
    float total = 0.22 + 0.25 * max(dot(n, to_eye), 0.0);
    total += 0.75 * share.x * max(dot(n, to_light[0]), 0.0);
    total += 0.35 * share.y * max(dot(n, to_light[1]), 0.0);
    fragment = vec4(colour * total * bright, 1.0);
}
"""
