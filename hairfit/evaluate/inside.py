"""Whether hair stays out of the head and grows from it."""

import dataclasses

import numpy as np
from jaxtyping import Float

from ..capture.distance import signed_distance
from ..types import Mesh, Strands
from .sample import Samples
from .shape import roots

DEEP = 1e-3
"""Points deeper in the head than this are faults; less is the mesh's own error."""

ROOTED = 2e-3
"""Roots nearer to the head than this grow from it. Metres."""


@dataclasses.dataclass(frozen=True)
class HeadErrors:
    """How strands meet the head.

    Attributes:
        share_inside: Share of the evenly spaced points that lie inside the head.
        deep: How many of those, and of the strands' own points, lie deeper than 1 mm.
        deepest: The greatest depth of any of them, in metres.
        rooted: Share of the roots that lie within 2 mm of the head.
    """

    share_inside: float
    deep: int
    deepest: float
    rooted: float


def compare_with_head(strands: Strands, samples: Samples, head: Mesh) -> HeadErrors:
    """Return how strands meet the head.

    Args:
        strands: The strands.
        samples: Evenly spaced points on them.
        head: The head mesh.
    """
    even = depths(samples.points, head)
    own = depths(strands.points.astype(np.float64), head)
    both = np.concatenate([even, own])
    distance = signed_distance(head, roots(strands))
    return HeadErrors(
        share_inside=float(np.mean(even > 0.0)),
        deep=int(np.sum(both > DEEP)),
        deepest=float(both.max()),
        rooted=float(np.mean(np.abs(distance) <= ROOTED)),
    )


def depths(
    points: Float[np.ndarray, "points 3"], head: Mesh
) -> Float[np.ndarray, " points"]:
    """Return how deep points lie inside the head, 0 outside. Metres."""
    low, high = head.vertices.min(0), head.vertices.max(0)
    # Most hair lies beside the box around the head, where no distance is needed.
    near = np.flatnonzero(((points >= low) & (points <= high)).all(1))
    depth = np.zeros(len(points))
    if len(near):
        depth[near] = np.maximum(-signed_distance(head, points[near]), 0.0)
    return depth
