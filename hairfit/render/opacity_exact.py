"""Opacity with all its steps: what more and more opacity maps come closer to."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .pieces import hair_pieces
from .view import View


class ExactLists(NamedTuple):
    r"""All hair of each texel, sorted by depth.

    Attributes:
        view: The light's view.
        first: Where the list of each texel starts, row after row, and the end of all.
        depth: Depth of each piece of hair at its middle, in metres, rising in a list.
        opacity: $\Omega$ behind it: its own and that of all before it in its list.
    """

    view: View
    first: Int[np.ndarray, " texels_and_1"]
    depth: Float[np.ndarray, " pieces"]
    opacity: Float[np.ndarray, " pieces"]

    def in_texels(
        self,
        row: Int[np.ndarray, " points"],
        column: Int[np.ndarray, " points"],
        depth: Float[np.ndarray, " points"],
    ) -> Float[np.ndarray, " points"]:
        """Return the opacity of the hair before depths in texels."""
        texel = row * self.view.width + column
        begin, end = self.first[texel], self.first[texel + 1]
        low, high = begin, end
        # Bisect all lists at once; those that are done stay as they are.
        while (low < high).any():
            middle = (low + high) // 2
            before = (low < high) & (self.depth[np.minimum(middle, end - 1)] < depth)
            low, high = (
                np.where(before, middle + 1, low),
                np.where(before, high, middle),
            )
        return np.where(low > begin, self.opacity[low - 1], 0.0)


def exact_lists(
    points: Float[np.ndarray, "strands knots 3"], width: float, view: View
) -> ExactLists:
    """Return all hair that a light sees, texel by texel.

    Args:
        points: Strands of equal counts of points, in metres.
        width: Width of a hair, in metres.
        view: The light's view.
    """
    pieces = hair_pieces(points, width, view)
    texel = pieces.row * view.width + pieces.column
    middle = pieces.depth.mean(1)
    order = np.lexsort((middle, texel))
    count = np.bincount(texel, minlength=view.width * view.height)
    first = np.concatenate([[0], np.cumsum(count)])
    total = np.concatenate([[0.0], np.cumsum(pieces.area[order])])
    opacity = total[1:] - np.repeat(total[first[:-1]], count)
    return ExactLists(view, first, middle[order], opacity)
