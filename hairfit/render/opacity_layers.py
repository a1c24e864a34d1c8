"""Opacity maps whose depths follow the hair of each texel; a reference in NumPy.

Slices across the whole scene waste most of theirs on air. Here every texel has its own:
spread between its first and last hair, or, as in deep opacity maps [Yuksel and Keyser
2008], at the same distances behind its first hair.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .pieces import Pieces, area_in_layers, cut_at_depths, hair_pieces
from .view import View

# A texel's hair at a single depth still needs layers that have a thickness, in metres.
THINNEST = 1e-6


class Range(NamedTuple):
    """Depths of the first and last hair in texels, in metres; infinite if none.

    Attributes:
        near: Depth of the first one.
        far: Depth of the last one.
    """

    near: Float[np.ndarray, "height width"]
    far: Float[np.ndarray, "height width"]


class LayeredMaps(NamedTuple):
    r"""Opacity between a light and layers behind the first hair of each texel.

    Attributes:
        view: The light's view.
        near: Where opacity starts to rise in each texel, in metres; infinite if there
            is no hair.
        offset: How far behind `near` each layer ends, in metres, rising.
        opacity: $\Omega$ at the end of each layer; no unit.
    """

    view: View
    near: Float[np.ndarray, "height width"]
    offset: Float[np.ndarray, "layers height width"]
    opacity: Float[np.ndarray, "layers height width"]

    def in_texels(
        self,
        row: Int[np.ndarray, " points"],
        column: Int[np.ndarray, " points"],
        depth: Float[np.ndarray, " points"],
    ) -> Float[np.ndarray, " points"]:
        """Return the opacity at depths in texels, linear within a layer."""
        behind = depth - self.near[row, column]
        total = begin = opacity = np.zeros(len(depth))
        for ends, opacities in zip(self.offset, self.opacity, strict=True):
            end, until = ends[row, column], opacities[row, column]
            share = np.clip((behind - begin) / (end - begin), 0.0, 1.0)
            total = total + share * (until - opacity)
            begin, opacity = end, until
        return total


def layered_maps(
    points: Float[np.ndarray, "strands knots 3"],
    width: float,
    view: View,
    layers: int,
    *,
    near_far: Range | None = None,
    offsets: Float[np.ndarray, " layers"] | None = None,
) -> LayeredMaps:
    """Return opacity in layers of each texel.

    Hair before a given range counts in the first layer, hair behind it in the last.

    Args:
        points: Strands of equal counts of points, in metres.
        width: Width of a hair, in metres.
        view: The light's view.
        layers: Number of layers.
        near_far: First and last depth of each texel; those of its hair if None.
        offsets: How far behind the first hair each layer ends, in metres, the same for
            all texels; if None, layers share evenly what lies up to the last hair.

    Raises:
        ValueError: If there is no layer, or offsets do not rise from above 0.
    """
    if layers < 1:
        raise ValueError(f"opacity needs at least 1 layer, got {layers}.")
    pieces = hair_pieces(points, width, view)
    near, far = hair_range(pieces, view) if near_far is None else near_far
    shape = (layers, view.height, view.width)
    if offsets is None:
        thick = np.full(near.shape, THINNEST)
        np.subtract(far, near, where=np.isfinite(near), out=thick)
        share = np.arange(1, layers + 1)[:, None, None] / layers
        offset = np.maximum(thick, THINNEST) * share
    else:
        check_offsets(offsets, layers)
        offset = np.broadcast_to(offsets[:, None, None], shape)
    at = pieces.row, pieces.column
    parts = cut_at_depths(pieces, near[at][:, None] + offset[:-1, *at].T)
    added = area_in_layers(pieces, parts, parts.slab, layers, view)
    return LayeredMaps(view, near, offset, np.cumsum(added, 0))


def hair_range(pieces: Pieces, view: View) -> Range:
    """Return the depths between which the hair of each texel lies."""
    near = np.full((view.height, view.width), np.inf)
    far = np.full(near.shape, -np.inf)
    np.minimum.at(near, (pieces.row, pieces.column), pieces.depth.min(1))
    np.maximum.at(far, (pieces.row, pieces.column), pieces.depth.max(1))
    return Range(near, np.where(np.isfinite(near), far, np.inf))


def check_offsets(offsets: Float[np.ndarray, " layers"], layers: int) -> None:
    """Refuse ends of layers that make no layers."""
    if len(offsets) != layers or not (np.diff(offsets, prepend=0.0) > 0.0).all():
        raise ValueError(
            f"{layers} layers need as many offsets that rise from above 0 m, got "
            f"{offsets.tolist()}."
        )
