"""Cluster contours that tile the scalp: even centres and the cells around them."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from ..model import ScalpContour

ANGLES = 32
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
    angle = 2.0 * np.pi * np.arange(ANGLES) / ANGLES
    spoke = np.stack([np.cos(angle), np.sin(angle)], 1)
    apart = centres[None] - centres[:, None]
    toward = np.einsum("ijk,ak->ija", apart, spoke)
    square = (apart**2).sum(-1)[..., None]
    # Along a spoke, the cell ends at the first bisector with another centre.
    bisector = np.where(toward > 1e-9, square / (2.0 * np.maximum(toward, 1e-9)), 9.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        border = np.where(spoke > 0, (1.0 - centres[:, None]), -centres[:, None])
        border = np.where(np.abs(spoke) > 1e-9, border / spoke, 9.0).min(-1)
    reach = OVERLAP * np.minimum(bisector.min(1), border)
    radius = reach.mean(1)
    return jax.vmap(ScalpContour)(
        jnp.asarray(centres), jnp.asarray(radius), jnp.asarray(reach - radius[:, None])
    )
