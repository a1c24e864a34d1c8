// As hairfit.render.view.View.see: pixel, depth, and pixels per metre (0 behind the eye).
uniform mat4 view_matrix;
uniform float pixels_per_metre;
vec4 see(vec3 p) {
    vec4 q = view_matrix * vec4(p, 1.0);
    bool ahead = q.w > 1e-3;
    float w = ahead ? q.w : 1.0;
    return vec4(q.xy / w, q.z, ahead ? pixels_per_metre / w : 0.0);
}
