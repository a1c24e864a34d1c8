"""Where hair can be along a light's rays, by the surfaces of its clusters."""

from typing import Any

import numpy as np

from ...types import Mesh
from ..opacity_layers import Range
from ..view import View
from .buffers import picture
from .context import set_uniforms, source
from .solid import FAR, projection


class Cover:
    """Draws the nearest and the farthest side of a surface that hair lies within.

    A few thousand triangles, instead of all segments of hair once more.
    """

    def __init__(self, context: Any, surface: Mesh):
        self.context, self.surface = context, surface
        self.program = context.program(
            vertex_shader=source("depth.vert"), fragment_shader=source("depth.frag")
        )
        parts = (
            np.ascontiguousarray(surface.vertices, np.float32),
            np.ascontiguousarray(surface.faces, np.int32),
        )
        self.buffers = [context.buffer(part) for part in parts]
        layout = [(self.buffers[0], "3f", "position")]
        self.array = context.vertex_array(self.program, layout, self.buffers[1])

    def range(self, view: View) -> Range:
        """Return the first and last depth of each texel, infinite where none is."""
        import moderngl

        size = view.width, view.height
        texture = self.context.texture(size, 1, dtype="f4")
        frame = self.context.framebuffer([texture])
        set_uniforms(self.program, projection(view, self.surface.vertices))
        found = []
        self.context.enable_only(moderngl.BLEND)
        for equation, none in ((moderngl.MIN, FAR), (moderngl.MAX, -FAR)):
            frame.use()
            frame.clear(none, none, none, none)
            self.context.blend_equation = equation
            self.array.render()
            values = picture(texture)[..., 0]
            empty = np.abs(values) >= 0.5 * FAR
            found.append(np.where(empty, np.sign(none) * np.inf, values))
        self.context.blend_equation = moderngl.FUNC_ADD
        frame.release()
        texture.release()
        return Range(*found)

    def release(self) -> None:
        """Give the memory back."""
        for thing in (self.array, *self.buffers, self.program):
            thing.release()
