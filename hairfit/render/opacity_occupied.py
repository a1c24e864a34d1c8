r"""Opacity in layers that lie only where a texel has hair: adaptive opacity maps.

The depths between the first and the last hair are cut into thin slabs, and each texel
has a bit for each slab that holds hair, as occupancy maps have [Sintorn and Assarsson
2009]. Its layers are its occupied slabs in turn; if it has more of them than layers,
the nearest half of the layers still are one slab each, and the others share the rest
evenly. So layers are thin where light changes, and none is spent on the empty space
between the near and the far side of a hairstyle.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .opacity_layers import Range
from .pieces import area_in_layers, cut_at_depths, hair_pieces
from .slices import uniform_slices
from .view import View

SLABS = 96


class OccupiedMaps(NamedTuple):
    r"""Opacity between a light and the ends of each texel's own layers.

    Attributes:
        view: The light's view.
        borders: Depths at which slabs begin and end, in metres.
        occupied: Whether a slab holds hair.
        opacity: $\Omega$ at the end of each layer; no unit.
    """

    view: View
    borders: Float[np.ndarray, " borders"]
    occupied: Bool[np.ndarray, "slabs height width"]
    opacity: Float[np.ndarray, "layers height width"]

    def in_texels(
        self,
        row: Int[np.ndarray, " points"],
        column: Int[np.ndarray, " points"],
        depth: Float[np.ndarray, " points"],
    ) -> Float[np.ndarray, " points"]:
        """Return the opacity at depths in texels, even within what a layer holds."""
        layers = len(self.opacity)
        slab, share = slab_and_share(depth, self.borders)
        held = self.occupied[:, row, column]
        number = held.sum(0)
        before = np.cumsum(held, 0) - held
        at = np.arange(len(depth))
        own = held[slab, at]
        rank = before[slab, at]
        place = rank + np.where(own, share, 0.0)
        last = np.where(own, rank, rank - 1)
        layer = layer_of_rank(np.maximum(last, 0), number, layers)
        begin = first_rank(layer, number, layers)
        end = first_rank(layer + 1, number, layers)
        total = np.concatenate(
            [np.zeros((1, *row.shape)), self.opacity[:, row, column]]
        )
        low, high = total[layer, at], total[layer + 1, at]
        part = (place - begin) / np.maximum(end - begin, 1)
        return np.where(last < 0, 0.0, low + np.clip(part, 0.0, 1.0) * (high - low))


def occupied_maps(
    points: Float[np.ndarray, "strands knots 3"],
    width: float,
    view: View,
    between: tuple[float, float],
    layers: int,
    *,
    occupied: Bool[np.ndarray, "slabs height width"] | None = None,
) -> OccupiedMaps:
    """Return opacity in layers where texels have hair.

    Args:
        points: Strands of equal counts of points, in metres.
        width: Width of a hair, in metres.
        view: The light's view.
        between: Depths of the first and the last hair.
        layers: Number of layers of a texel.
        occupied: Slabs that are taken to hold hair, as `within` has them; those that
            do if None. What lies in others counts in the layer of the one behind.

    Raises:
        ValueError: If there is not at least one layer.
    """
    if layers < 1:
        raise ValueError(f"opacity needs at least 1 layer, got {layers}.")
    borders = uniform_slices(*between, SLABS)
    pieces = hair_pieces(points, width, view)
    parts = cut_at_depths(pieces, borders[1:-1])
    row, column = pieces.row[parts.piece], pieces.column[parts.piece]
    if occupied is None:
        occupied = np.zeros((SLABS, view.height, view.width), bool)
        occupied[parts.slab, row, column] = True
    number, before = occupied.sum(0), np.cumsum(occupied, 0) - occupied
    rank = before[parts.slab, row, column]
    held = number[row, column]
    layer = layer_of_rank(np.minimum(rank, np.maximum(held - 1, 0)), held, layers)
    added = area_in_layers(pieces, parts, layer, layers, view)
    return OccupiedMaps(view, borders, occupied, np.cumsum(added, 0))


def within(
    known: Range, borders: Float[np.ndarray, " borders"]
) -> Bool[np.ndarray, "slabs height width"]:
    """Return the slabs between two depths of each texel, all if they are infinite."""
    near = np.where(np.isfinite(known.near), known.near, borders[0])
    far = np.where(np.isfinite(known.far), known.far, borders[-1])
    first, last = slab_and_share(near, borders)[0], slab_and_share(far, borders)[0]
    slab = np.arange(len(borders) - 1)[:, None, None]
    return (slab >= first) & (slab <= last)


def slab_and_share(
    depth: Float[np.ndarray, "*points"], borders: Float[np.ndarray, " borders"]
) -> tuple[Int[np.ndarray, "*points"], Float[np.ndarray, "*points"]]:
    """Return the even slab that holds each depth, and how far into it."""
    slabs = len(borders) - 1
    place = (depth - borders[0]) / (borders[-1] - borders[0]) * slabs
    slab = np.clip(np.floor(place), 0, slabs - 1).astype(np.int64)
    return slab, np.clip(place - slab, 0.0, 1.0)


def layer_of_rank(
    rank: Int[np.ndarray, "*texels"], number: Int[np.ndarray, "*texels"], layers: int
) -> Int[np.ndarray, "*texels"]:
    """Return the layer of the n-th occupied slab of a texel.

    Args:
        rank: Occupied slabs before it.
        number: Occupied slabs of its texel.
        layers: Layers of a texel.
    """
    single = layers // 2
    shared = (rank - single) * (layers - single) // np.maximum(number - single, 1)
    return np.where((number <= layers) | (rank < single), rank, single + shared)


def first_rank(
    layer: Int[np.ndarray, "*texels"], number: Int[np.ndarray, "*texels"], layers: int
) -> Int[np.ndarray, "*texels"]:
    """Return the first occupied slab of a layer, counted among the occupied ones."""
    single = layers // 2
    over = (layer - single) * np.maximum(number - single, 1)
    shared = single - (-over // (layers - single))
    return np.where((number <= layers) | (layer < single), layer, shared)
