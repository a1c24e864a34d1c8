"""Table 6-1 of the thesis as it was meant in 2001: the measure for opacity maps' speed.

All lines are drawn for every map, clipped to its slab, and added up; the buffer is read
back after each. `render.gl.passes` has a way that drops lines early.
"""

from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from hairfit.render.gl.buffers import picture
from hairfit.render.gl.context import set_uniforms
from hairfit.render.gl.passes import open_ended
from hairfit.render.gl.solid import projection
from hairfit.render.opacity_maps import OpacityMaps
from hairfit.render.view import View, see_all

# Antialiased by the driver, as section 6.2.1 has it, clipped by the fragment; the same
# without antialiasing; or without, by two clip planes. All three with clip planes and
# antialiasing crash Mesa 22.3.
Way = Literal["smooth", "fragment", "planes"]
CLIP_PLANES = 0x3000, 0x3001  # GL_CLIP_DISTANCE0 and 1
LINE_SMOOTH = 0x0B20

VERTEX = """
#version 330
uniform mat4 clip_from_world;
uniform vec4 depth_row;
uniform vec2 slab;
in vec3 position;
in float share;
flat out float value;
out float depth;
#ifdef PLANES
out float gl_ClipDistance[2];
#endif
void main() {
    depth = dot(depth_row, vec4(position, 1.0));
    value = share;
    gl_Position = clip_from_world * vec4(position, 1.0);
#ifdef PLANES
    gl_ClipDistance[0] = depth - slab.x;
    gl_ClipDistance[1] = slab.y - depth;
#endif
}
"""
FRAGMENT = """
#version 330
uniform vec2 slab;
flat in float value;
in float depth;
out vec4 added;
void main() {
#ifndef PLANES
    if (depth < slab.x || depth >= slab.y) discard;
#endif
    added = vec4(value, 0.0, 0.0, 1.0);
}
"""


class Table61:
    """Strands from which maps are drawn for one light.

    Buffers and programs are made once.
    """

    def __init__(
        self,
        context: Any,
        strands: Float[np.ndarray, "strands knots 3"],
        width: float,
        view: View,
        way: Way,
    ):
        count, knots, _ = strands.shape
        seen = see_all(np.asarray(strands, np.float64), view)
        step = np.diff(seen[..., :2], axis=1)
        scale = 0.5 * (seen[:, 1:, 3] + seen[:, :-1, 3])
        longer = np.maximum(np.abs(step).max(-1), 1e-12)
        rows = np.zeros((count, knots, 4), np.float32)
        rows[..., :3] = strands
        # A line's last vertex says what each of its fragments adds.
        rows[:, 1:, 3] = width * scale * np.linalg.norm(step, axis=-1) / longer
        first = np.arange(count * knots).reshape(count, knots)[:, :-1].reshape(-1)
        index = np.stack([first, first + 1], 1).astype(np.int32)
        self.context, self.view, self.way = context, view, way
        define = "#define PLANES" if way == "planes" else ""
        shaders = [
            text.replace("#version 330", f"#version 330\n{define}").strip()
            for text in (VERTEX, FRAGMENT)
        ]
        self.program = context.program(
            vertex_shader=shaders[0], fragment_shader=shaders[1]
        )
        set_uniforms(self.program, projection(view, strands))
        layout = [(context.buffer(rows), "3f 1f", "position", "share")]
        self.array = context.vertex_array(self.program, layout, context.buffer(index))
        self.texture = context.texture((view.width, view.height), 1, dtype="f4")
        self.frame = context.framebuffer([self.texture])

    def draw(self, slices: Float[np.ndarray, " maps"]) -> OpacityMaps:
        """Return maps: loop 3 of table 6-1 without its look-ups."""
        import moderngl

        smooth = self.way == "smooth"
        borders, view = open_ended(slices), self.view
        opacity = np.zeros((len(slices), view.height, view.width), np.float32)
        self.frame.use()
        self.frame.clear()
        self.context.enable_only(moderngl.BLEND)
        weight = moderngl.SRC_ALPHA if smooth else moderngl.ONE
        self.context.blend_func = weight, moderngl.ONE
        states = {"smooth": (LINE_SMOOTH,), "planes": CLIP_PLANES}.get(self.way, ())
        for state in states:
            self.context.enable_direct(state)
        for i in range(1, len(slices)):
            slab = float(borders[i - 1]), float(borders[i])
            set_uniforms(self.program, {"slab": slab})
            self.array.render(moderngl.LINES)
            opacity[i] = picture(self.texture)[..., 0]
        for state in states:
            self.context.disable_direct(state)
        return OpacityMaps(view, slices, opacity)
