"""Opacity shadow maps, the reference in NumPy [Kim02, section 6.2.1, table 6-1]."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .pieces import area_in_layers, cut_at_depths, hair_pieces
from .slices import slab_of
from .view import View


class OpacityMaps(NamedTuple):
    r"""Opacity between a light and planes across its rays.

    Attributes:
        view: The light's view.
        slices: Depths $D_0$ to $D_N$ of the maps, in metres, rising.
        opacity: $\Omega$ at each of them; no unit. The first map is 0.
    """

    view: View
    slices: Float[np.ndarray, " maps"]
    opacity: Float[np.ndarray, "maps height width"]

    def in_texels(
        self,
        row: Int[np.ndarray, " points"],
        column: Int[np.ndarray, " points"],
        depth: Float[np.ndarray, " points"],
    ) -> Float[np.ndarray, " points"]:
        """Return the opacity at depths in texels, linear between maps (6-2)."""
        slab = slab_of(depth, self.slices)
        low, high = self.opacity[slab + np.arange(2)[:, None], row, column]
        return low + self.share(depth, slab) * (high - low)

    def in_texels_cubic(
        self,
        row: Int[np.ndarray, " points"],
        column: Int[np.ndarray, " points"],
        depth: Float[np.ndarray, " points"],
    ) -> Float[np.ndarray, " points"]:
        """Return the same by the cubic through four maps that section 6.2.1 names.

        Opacity never falls, and a free spline would overshoot: slopes are limited as
        Fritsch and Butland do (1984), with their weights for uneven slices. An end
        slab's missing neighbour is taken to be like the slab itself.
        """
        slab = slab_of(depth, self.slices)
        last = len(self.slices) - 2
        beside = np.clip(slab + np.array([[-1], [0], [1]]), 0, last)
        thick = np.maximum(np.diff(self.slices), 1e-12)[beside]
        rise = self.opacity[beside + 1, row, column] - self.opacity[beside, row, column]
        slope = rise / thick
        begin = limited(slope[:2], thick[:2])
        end = limited(slope[1:], thick[1:])
        t = self.share(depth, slab)
        low = self.opacity[slab, row, column]
        s = 1.0 - t
        bend = thick[1] * t * s * (begin * s - end * t)
        return low + rise[1] * t * t * (3.0 - 2.0 * t) + bend

    def share(
        self, depth: Float[np.ndarray, " points"], slab: Int[np.ndarray, " points"]
    ) -> Float[np.ndarray, " points"]:
        """Return where depths lie in their slabs, from 0 to 1."""
        thick = np.maximum(np.diff(self.slices), 1e-12)[slab]
        return np.clip((depth - self.slices[slab]) / thick, 0.0, 1.0)


def opacity_maps(
    points: Float[np.ndarray, "strands knots 3"],
    width: float,
    view: View,
    slices: Float[np.ndarray, " maps"],
) -> OpacityMaps:
    """Return what loop 3 of table 6-1 draws: the scene clipped to slab after slab.

    Sums may be taken in any order, so here one histogram takes all slabs at once. Hair
    before the first depth counts in the first slab, hair beyond the last in the last.

    Args:
        points: Strands of equal counts of points, in metres.
        width: Width of a hair, in metres.
        view: The light's view.
        slices: Depths of the maps, in metres, rising.

    Raises:
        ValueError: If there are fewer than two depths.
    """
    if len(slices) < 2:
        raise ValueError(f"opacity maps need at least 2 depths, got {len(slices)}.")
    pieces = hair_pieces(points, width, view)
    parts = cut_at_depths(pieces, slices[1:-1])
    added = area_in_layers(pieces, parts, parts.slab, len(slices) - 1, view)
    opacity = np.concatenate([np.zeros_like(added[:1]), np.cumsum(added, 0)])
    return OpacityMaps(view, slices, opacity)


def limited(
    slope: Float[np.ndarray, "2 points"], thick: Float[np.ndarray, "2 points"]
) -> Float[np.ndarray, " points"]:
    """Return slopes between slabs that keep a cubic within its maps.

    Their weighted harmonic mean; 0 where either slab is empty.
    """
    weight = thick.sum(0) + thick[::-1]
    flat = (slope < 1e-200).any(0)  # the inverse of less could overflow
    safe = np.where(flat, 1.0, slope)
    return np.where(flat, 0.0, weight.sum(0) / (weight / safe).sum(0))
