"""Opacity shadow maps by drawing lines, as the thesis does [Kim02, table 6-1].

These ways need OpenGL 3.3 only. A fragment of a line one pixel wide stands for a share
of its pixel: what the hair is wide times the length of line that falls to a fragment.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..opacity_maps import OpacityMaps
from ..view import View, see_all
from .buffers import picture, point_rows
from .context import set_uniforms, source

# OpenGL 3.3 promises eight targets of four numbers.
MOST_TARGETS = 8
# Deeper than any hair: the first and the last slab have no end.
ENDLESS = 1e30
# Hair between two depths is at least this deep, in metres.
THINNEST = 1e-6


def maps_by_passes(
    context: Any,
    strands: Float[np.ndarray, "strands knots 3"],
    width: float,
    view: View,
    slices: Float[np.ndarray, " maps"],
) -> OpacityMaps:
    """Return opacity maps drawn slab after slab, read back after each [table 6-1].

    Args:
        context: OpenGL of version 3.3 or more.
        strands: Strands of equal counts of points, in metres.
        width: Width of a hair, in metres.
        view: The light's view.
        slices: Depths of the maps, in metres, rising.

    Raises:
        ValueError: If there are fewer than two depths.
    """
    lines = LineMaps(context, strands, width)
    maps = lines.by_passes(view, slices)
    lines.release()
    return maps


def maps_by_targets(
    context: Any,
    strands: Float[np.ndarray, "strands knots 3"],
    width: float,
    view: View,
    slices: Float[np.ndarray, " maps"],
) -> OpacityMaps:
    """Return opacity maps of which up to 32 are drawn at once.

    Each of eight targets takes four slabs [Nalu, GPU Gems 2, chapter 23]; arguments
    and what is refused are those of `maps_by_passes`.
    """
    lines = LineMaps(context, strands, width)
    maps = lines.by_targets(view, slices)
    lines.release()
    return maps


class Target(NamedTuple):
    """Textures that are drawn into at once, and what binds them."""

    textures: list[Any]
    frame: Any


class LineMaps:
    """Strands from which maps of one light after another are drawn.

    Buffers and programs are made once; give them back with `release`.
    """

    def __init__(
        self,
        context: Any,
        strands: Float[np.ndarray, "strands knots 3"],
        width: float,
    ):
        self.context = context
        self.points = np.asarray(strands, np.float64).reshape(-1, 3)
        self.buffer = context.buffer(point_rows(strands, width).tobytes())
        self.arrays: dict[int, Any] = {}
        self.targets: dict[tuple[int, ...], Target] = {}

    def by_passes(self, view: View, slices: Float[np.ndarray, " maps"]) -> OpacityMaps:
        """Return maps drawn by one pass a slab into one target that is not cleared."""
        borders = open_ended(slices)
        array, target = self.array(0), self.target(view, 1, 1)
        self.begin(array.program, target, view)
        opacity = np.zeros((len(slices), view.height, view.width), np.float32)
        for i in range(1, len(slices)):
            self.draw(array, borders[i - 1], borders[i])
            opacity[i] = picture(target.textures[0])[..., 0]
        return OpacityMaps(view, slices, opacity)

    def by_targets(self, view: View, slices: Float[np.ndarray, " maps"]) -> OpacityMaps:
        """Return maps drawn 32 slabs at a time, summed along the light after."""
        borders = open_ended(slices)
        count = len(slices) - 1
        number = min(MOST_TARGETS, (count + 3) // 4)
        array, target = self.array(number), self.target(view, number, 4)
        opacity = np.zeros((count + 1, view.height, view.width), np.float32)
        for first in range(0, count, 4 * number):
            last = min(first + 4 * number, count)
            own = np.full(4 * number + 1, borders[last])
            own[: last - first + 1] = borders[first : last + 1]
            self.begin(array.program, target, view)
            ends = {"begin": own[:-1].reshape(-1, 4), "end": own[1:].reshape(-1, 4)}
            for name, value in ends.items():
                array.program[name].write(value.astype(np.float32).tobytes())
            self.draw(array, borders[first], borders[last])
            parts = [picture(texture) for texture in target.textures]
            for slab in range(first, last):
                own = parts[(slab - first) // 4][..., (slab - first) % 4]
                np.add(opacity[slab], own, out=opacity[slab + 1])
        return OpacityMaps(view, slices, opacity)

    def begin(self, program: Any, target: Target, view: View) -> None:
        """Clear a target, and let what is drawn be added to it."""
        import moderngl

        depth = see_all(self.points, view)[:, 2]
        near, far = float(depth.min(initial=0.0)), float(depth.max(initial=1.0))
        set_uniforms(
            program,
            {
                "view_matrix": np.asarray(view.matrix, np.float64),
                "pixels_per_metre": float(view.pixels_per_metre),
                "size": (float(view.width), float(view.height)),
                "range": (near - 1e-3, far + 1e-3),
            },
        )
        target.frame.use()
        target.frame.clear()
        self.context.enable_only(moderngl.BLEND)
        self.context.blend_func = moderngl.ONE, moderngl.ONE

    def draw(self, array: Any, begin: float, end: float) -> None:
        """Draw the hair between two depths."""
        import moderngl

        set_uniforms(array.program, {"slab": (float(begin), float(end))})
        array.render(moderngl.LINE_STRIP)

    def array(self, targets: int) -> Any:
        """Return what draws into so many targets of four slabs; 0 for one slab."""
        if targets not in self.arrays:
            constants = {"COLOURED": 0, "TARGETS": targets, "THINNEST": str(THINNEST)}
            fragment = "slabs.frag" if targets else "slab.frag"
            program = self.context.program(
                vertex_shader=source("hair.vert", **constants),
                geometry_shader=source("line.geom", **constants),
                fragment_shader=source(fragment, **constants),
            )
            layout = [(self.buffer, "4f", "point")]
            self.arrays[targets] = self.context.vertex_array(program, layout)
        return self.arrays[targets]

    def target(self, view: View, number: int, parts: int) -> Target:
        """Return textures of 32 bit floats of a view's size."""
        key = view.width, view.height, number, parts
        if key not in self.targets:
            textures = [
                self.context.texture(key[:2], parts, dtype="f4") for _ in range(number)
            ]
            self.targets[key] = Target(textures, self.context.framebuffer(textures))
        return self.targets[key]

    def release(self) -> None:
        """Give the memory back."""
        for target in self.targets.values():
            for thing in (target.frame, *target.textures):
                thing.release()
        for array in self.arrays.values():
            array.program.release()
            array.release()
        self.buffer.release()


def open_ended(slices: Float[np.ndarray, " maps"]) -> Float[np.ndarray, " maps"]:
    """Return depths of which the first is before all hair, and the last behind it."""
    if len(slices) < 2:
        raise ValueError(f"opacity maps need at least 2 depths, got {len(slices)}.")
    return np.concatenate([[-ENDLESS], slices[1:-1], [ENDLESS]])
