"""The surfaces of clusters, as triangles."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .cylinder import GeneralizedCylinder, cylinder_knots


class Tubes(NamedTuple):
    """Triangles around clusters, open at both ends.

    Attributes:
        points: Points on the contours, in metres.
        faces: Three points of each triangle.
    """

    points: Float[Array, "clusters knots turns 3"]
    faces: Int[np.ndarray, "faces 3"]


def tubes(cylinders: GeneralizedCylinder, turns: int = 8) -> Tubes:
    """Return the surfaces of many clusters: their contours at all knots, joined.

    Args:
        cylinders: Clusters, stacked.
        turns: Points around each contour.

    Raises:
        ValueError: If contours have fewer than three points.
    """
    if turns < 3:
        raise ValueError(f"a contour needs at least 3 points, got {turns}.")
    theta = jnp.asarray(2.0 * np.pi * np.arange(turns) / turns)
    around = jax.vmap(cylinder_knots, (None, None, 0), 1)
    points = jax.vmap(around, (0, None, None))(cylinders, 1.0, theta)
    clusters, knots = points.shape[:2]
    index = np.arange(clusters * knots * turns).reshape(clusters, knots, turns)
    a, b = index[:, :-1], np.roll(index, -1, 2)[:, :-1]
    c, d = index[:, 1:], np.roll(index, -1, 2)[:, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([b, d, c], -1)], -2)
    return Tubes(points, faces.reshape(-1, 3))
