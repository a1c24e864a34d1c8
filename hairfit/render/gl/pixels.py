"""Hair in pixels: lists of pieces of hair, blended in order [Kim02, section 6.3]."""

import dataclasses
from typing import Any

import numpy as np

from ..view import View
from .buffers import Buffers
from .context import Kernel, read
from .solid import Solid

POINTS, SEEN, HEADS, RECORDS, COUNTER = range(5)
COLOUR = IMAGE = 6
RECORD = 16  # bytes of a piece of hair in a list


class TooManyPiecesError(RuntimeError):
    """A picture has more pieces of hair than a buffer holds: draw it in parts."""


@dataclasses.dataclass(frozen=True)
class FrameStyle:
    """What a frame costs.

    Attributes:
        deep: Hairs of a pixel that are blended in order; those behind them are blended
            as one (a k-buffer).
        samples: Samples along the side of a pixel, of what is not hair.
        fine: Pixels along the side of each pixel that are drawn and averaged. Blending
            takes hairs to lie in a pixel at random; small pixels know better.
        white: Luminance that becomes white by the tone curve; 0 for no curve.
    """

    deep: int = 8
    samples: int = 2
    fine: int = 1
    white: float = 0.0


class Pixels:
    """Draws hair whose vertices have colours.

    Attributes:
        buffers: Lists and picture.
    """

    def __init__(self, context: Any, style: FrameStyle):
        self.context, self.style = context, style
        self.buffers = Buffers(context)
        self.see = Kernel(context, "see.comp")
        self.fragments = Kernel(context, "fragments.comp", SAMPLES=style.samples)
        self.blends: dict[tuple[bool, int], Kernel] = {}
        limit = int(context.info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"])
        self.most_pieces = min(limit, 1 << 31) // RECORD

    def draw(
        self,
        view: View,
        hair: dict[str, Any],
        count: int,
        solid: Solid,
        *,
        strips: int,
        width: float,
        alpha: float,
        linear: bool,
    ) -> np.ndarray:
        """Return a picture: 8 bit sRGB packed in an integer a pixel, or linear light.

        Args:
            view: The camera's view.
            hair: Buffers `points`, as shadow maps take them, and `colour`.
            count: Number of vertices.
            solid: What is not hair, drawn already.
            strips: How many thin lines one hair is drawn as.
            width: Width of a hair, in metres.
            alpha: Opacity of what hair covers.
            linear: Whether to return premultiplied linear light and coverage.

        Raises:
            TooManyPiecesError: If the picture must be drawn in parts.
        """
        self.buffers.reserve("seen", 16 * count)
        buffers = {POINTS: hair["points"], SEEN: self.buffers["seen"]}
        self.see.run(
            count,
            buffers,
            view_matrix=np.asarray(view.matrix, np.float64),
            pixels_per_metre=float(view.pixels_per_metre),
        )
        solid.bind()
        size = view.width, view.height
        buffers[COLOUR] = hair["colour"]
        self.gather(count, buffers, size=size, strips=strips, alpha=alpha, solid=1)
        pixels = view.width * view.height
        self.buffers.reserve("image", (16 if linear else 4) * pixels)
        self.blend(linear, strips).run(
            pixels,
            {
                HEADS: self.buffers["heads"],
                RECORDS: self.buffers["records"],
                IMAGE: self.buffers["image"],
            },
            size=size,
            merge=width if strips > 1 else 0.0,
            white=self.style.white,
            ground=0,
        )
        if linear:
            shape = (view.height, view.width, 4)
            return read(self.buffers["image"], np.float32, shape)
        return read(self.buffers["image"], np.uint32, (view.height, view.width))

    def gather(self, count: int, buffers: dict, **uniforms: Any) -> None:
        """List the pieces of hair of every pixel."""
        width, height = uniforms["size"]
        guess = min(6 * count, self.most_pieces)
        self.buffers.reserve("records", RECORD * guess)
        while True:
            self.buffers.write("heads", np.zeros(width * height, np.uint32))
            self.buffers.write("counter", np.zeros(4, np.uint32))
            capacity = self.buffers["records"].size // RECORD
            lists = {
                HEADS: self.buffers["heads"],
                RECORDS: self.buffers["records"],
                COUNTER: self.buffers["counter"],
            }
            self.fragments.run(
                max(count - 1, 0), {**buffers, **lists}, capacity=capacity, **uniforms
            )
            used = int(read(self.buffers["counter"], np.uint32, (1,))[0])
            if used <= capacity:
                return
            if used > self.most_pieces:
                raise TooManyPiecesError(f"{used} pieces of hair.")
            self.buffers.reserve("records", RECORD * used)

    def blend(self, linear: bool, strips: int) -> Kernel:
        """Return the kernel that blends; compiled once for each kind of picture."""
        deep = min(self.style.deep * strips, 64)
        if (linear, deep) not in self.blends:
            self.blends[linear, deep] = Kernel(
                self.context,
                "blend.comp",
                LINEAR=int(linear),
                PIXEL="vec4" if linear else "uint",
                DEEP=deep,
                SAMPLES=self.style.samples,
            )
        return self.blends[linear, deep]

    def release(self) -> None:
        """Give all memory back."""
        self.buffers.release()
