"""Opacity shadow maps in one pass, by compute shaders [Kim02, section 6.2]."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ..opacity_layers import Range
from ..opacity_occupied import SLABS, within
from ..shadow_style import ShadowStyle
from ..view import View
from .context import Kernel, read

# Opacity is counted in millionths: sums of integers do not depend on their order, so
# that every run gives the same bits. A cell holds up to 4096.
UNIT = 1048576.0
POINTS, SEEN, CELLS, LIGHT, SLICES, MASKS = range(6)
WORDS = SLABS // 32  # of a texel's mask


class ShadowMaps:
    """Maps of one light at a time, and what they let through to points.

    Buffers are kept between lights and frames; release them with `release`.
    """

    def __init__(self, context: Any, style: ShadowStyle):
        self.context = context
        self.style = style
        self.adaptive = style.scheme == "adaptive"
        kind = "layers" if self.adaptive else "slabs"
        names = ("see", "fill", f"splat_{kind}", "sum_slabs", f"light_{kind}")
        constants = {
            "EVEN": int(style.scheme == "uniform"),
            "BOX": 3 if style.filter == "box3" else 1,
            "CUBIC": int(style.interpolation == "cubic"),
        }
        if self.adaptive:
            names = (*names, "occupy")
        self.kernels = {
            name: Kernel(context, f"{name}.comp", **constants) for name in names
        }
        texels = style.size**2
        self.buffers: dict[int, Any] = {
            CELLS: context.buffer(reserve=texels * style.slices * 4),
            SLICES: context.buffer(reserve=(style.slices + 1) * 4),
        }
        if self.adaptive:
            self.buffers[MASKS] = context.buffer(reserve=texels * 4 * WORDS)
        self.uniforms: dict[str, Any] = {}

    @property
    def memory(self) -> int:
        """Bytes of the maps."""
        parts = (CELLS, MASKS) if self.adaptive else (CELLS,)
        return sum(self.buffers[part].size for part in parts)

    def build(
        self,
        points: Any,
        count: int,
        view: View,
        depth: Float[np.ndarray, " points"],
        known: Range | None = None,
    ) -> None:
        """Make the maps of a light.

        Args:
            points: Buffer of the vertices of strands: position, and the width of the
                segment to the next vertex, 0 at tips.
            count: Number of vertices.
            view: The light's view, of the style's size.
            depth: Depths of vertices, or of some of them, where slices go.
            known: Where hair can be, for adaptive layers, as by a tree's cylinders;
                without it the strands are walked once more.
        """
        style = self.style
        slices = style.depths(depth)
        self.buffers[SLICES].write(slices.astype(np.float32).tobytes())
        self.uniforms = {
            "view_matrix": np.asarray(view.matrix, np.float64),
            "pixels_per_metre": float(view.pixels_per_metre),
            "size": (style.size, style.size),
            "slabs": style.slices,
            "between": (float(slices[0]), float(slices[-1])),
            "unit": UNIT,
        }
        if SEEN in self.buffers and self.buffers[SEEN].size < 16 * count:
            self.buffers.pop(SEEN).release()
        if SEEN not in self.buffers:
            self.buffers[SEEN] = self.context.buffer(reserve=16 * max(count, 1))
        buffers = {**self.buffers, POINTS: points}
        self.run("see", count, buffers)
        self.fill(CELLS, 0)
        if self.adaptive:
            self.occupy(buffers, count, slices, known)
            self.run("splat_layers", count - 1, buffers)
        else:
            self.run("splat_slabs", count - 1, buffers)
        self.run("sum_slabs", style.size**2, buffers)

    def occupy(
        self, buffers: dict, count: int, slices: np.ndarray, known: Range | None
    ) -> None:
        """Write which slabs of each texel hold hair."""
        if known is None:
            self.fill(MASKS, 0)
            self.run("occupy", count - 1, buffers)
            return
        borders = np.linspace(slices[0], slices[-1], SLABS + 1)
        held = np.moveaxis(within(known, borders), 0, -1)
        bits = np.packbits(held, axis=-1, bitorder="little")
        self.buffers[MASKS].write(np.ascontiguousarray(bits))

    def light(
        self,
        points: Any,
        count: int,
        out: Any,
        offset: int = 0,
        head: Any = None,
    ) -> None:
        """Write what lies between the light and points.

        Args:
            points: Buffer of points, four numbers each, of which the last is not used.
            count: Their number.
            out: Buffer of pairs: opacity of the hair before a point, and the share of
                light that the head lets by.
            offset: The pair to begin with.
            head: Texture of the head's depth in the light's view, of the maps' size.
        """
        kind = "light_layers" if self.adaptive else "light_slabs"
        if head is not None:
            head.use(location=0)
        self.run(
            kind,
            count,
            {**self.buffers, POINTS: points, LIGHT: out},
            bias=self.style.bias,
            offset=offset,
            has_head=head is not None,
            head=0,
        )

    def run(self, name: str, count: int, buffers: dict, **own: Any) -> None:
        """Run a kernel with the buffers that it may need."""
        self.kernels[name].run(count, buffers, **{**self.uniforms, **own})

    def fill(self, part: int, value: int) -> None:
        """Fill a buffer with one value."""
        buffer = self.buffers[part]
        self.kernels["fill"].run(buffer.size // 16, {CELLS: buffer}, value=value)

    def opacity(self) -> Float[np.ndarray, "slices height width"]:
        """Return the opacity between the light and the end of each slab or layer."""
        n = self.style.size
        cells = read(self.buffers[CELLS], np.uint32, (n, self.style.slices, n))
        return cells.transpose(1, 0, 2) / UNIT

    def occupied(self) -> Bool[np.ndarray, "slabs height width"]:
        """Return which slabs of each texel hold hair, of adaptive maps."""
        n = self.style.size
        masks = read(self.buffers[MASKS], np.uint8, (n, n, 4 * WORDS))
        bits = np.unpackbits(masks, axis=-1, bitorder="little")
        return np.moveaxis(bits.astype(bool), -1, 0)

    def release(self) -> None:
        """Give the memory back."""
        for buffer in self.buffers.values():
            buffer.release()
