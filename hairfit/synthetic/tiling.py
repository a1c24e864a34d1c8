"""Cluster contours that tile the scalp: even centres and the cells around them."""

import numpy as np
from jaxtyping import Float, Int

from ..model import ScalpContour, tiling

OVERLAP = 1.12


def scatter(
    points: Float[np.ndarray, "points 3"], count: int, rng: np.random.Generator
) -> Int[np.ndarray, " count"]:
    """Return the indices of `count` points spread evenly, by Lloyd's relaxation."""
    chosen = rng.choice(len(points), count, replace=False)
    for _ in range(12):
        apart = np.linalg.norm(points[:, None] - points[chosen][None], axis=2)
        cell = apart.argmin(1)
        for k in range(count):
            mine = np.flatnonzero(cell == k)
            if len(mine):
                middle = points[mine].mean(0)
                rest = np.linalg.norm(points[mine] - middle, axis=1)
                chosen[k] = mine[rest.argmin()]
    return chosen


def tile_contours(centres: Float[np.ndarray, "clusters 2"]) -> ScalpContour:
    """Return contours in scalp space that fill the cells of a Voronoi diagram.

    They overlap a little, so that no root is left between them; there the closest
    centre owns it.
    """
    return tiling.tile_contours(centres, OVERLAP)
