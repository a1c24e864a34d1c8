"""Signed distance to a head: negative inside it, also for open meshes."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..model.collide import DistanceField, sample_field
from ..types import Mesh

ROUNDING = 1e-6  # metres: distances on a grid are kept as float32


def signed_distance(
    head: Mesh, points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Return the distance of points to a mesh in metres, negative inside it.

    Inside is where the generalized winding number (Jacobson et al. 2013, by the fast
    form of Barill et al. 2018) exceeds one half, so that an open neck or overlapping
    parts do no harm.
    """
    return nearest_skin(head, points).distance


class Nearest(NamedTuple):
    """The skin nearest to points.

    Attributes:
        distance: Distance in metres, negative inside the head.
        closest: The closest points of the mesh.
    """

    distance: Float[np.ndarray, " points"]
    closest: Float[np.ndarray, "points 3"]


def nearest_skin(head: Mesh, points: Float[np.ndarray, "points 3"]) -> Nearest:
    """Return the signed distance as `signed_distance` does, and the closest points."""
    import igl

    distance, _, closest, _ = igl.signed_distance(
        np.ascontiguousarray(points, np.float64),
        np.ascontiguousarray(head.vertices, np.float64),
        np.ascontiguousarray(head.faces, np.int64),
        sign_type=igl.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER,
    )
    return Nearest(np.atleast_1d(distance), np.asarray(closest).reshape(-1, 3))


def head_field(head: Mesh, cell: float = 0.004, margin: float = 0.02) -> DistanceField:
    """Return the signed distances around a head as a grid [Kim02, section 4.6.4].

    What `model.collide` looks up instead of the mesh (figure 4-21).

    Args:
        head: The head.
        cell: Distance between the grid's points, in metres. Parts of the head that are
            thinner than two cells, such as ears, come out too small.
        margin: How far the grid reaches beyond the head, in metres; a gap above the
            skin must be less.
    """
    low, high = head.vertices.min(axis=0) - margin, head.vertices.max(axis=0) + margin
    return sample_field(lambda p: signed_distance(head, p), low, high, cell)


def least_distance(
    field: DistanceField, points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Return what the signed distance of points from a head is at least, in metres.

    It changes by no more than one walks from the grid's nearest point. A look-up so
    spares the exact distance of all that is not near the skin.

    Args:
        field: Distances from the head, as `head_field` has them: the grid reaches
            beyond the head.
        points: Points, in metres.
    """
    place = (points - np.asarray(field.origin, np.float64)) / float(field.cell)
    last = np.array(field.distance.shape) - 1
    node = np.clip(np.rint(place), 0, last).astype(int)
    away = np.linalg.norm(place - node, axis=1)
    beyond = np.linalg.norm(place - np.clip(place, 0, last), axis=1)
    known = np.asarray(field.distance, np.float64)[tuple(node.T)]
    least = known - float(field.cell) * away - ROUNDING
    # The head lies inside the grid.
    return np.where(beyond > 0, float(field.cell) * beyond, least)


def push_out(
    head: Mesh,
    points: Float[np.ndarray, "points 3"],
    gap: float,
    field: DistanceField | None = None,
) -> Float[np.ndarray, "points 3"]:
    """Return the points, those inside the head laid `gap` metres above its skin.

    Args:
        head: The head.
        points: Points, in metres.
        gap: Distance from the skin of what was inside.
        field: Distances from the head, as `head_field` has them: the same result,
            sooner, where many points are far from the skin.
    """
    out = points.copy()
    if field is None:
        reach = head.vertices.min(axis=0), head.vertices.max(axis=0)
        may = ((points > reach[0]) & (points < reach[1])).all(axis=1)
    else:
        may = least_distance(field, points) < 0
    near = np.flatnonzero(may)
    for _ in range(3):
        distance, closest = nearest_skin(head, out[near])
        inside = distance < 0
        near, closest = near[inside], closest[inside]
        if not len(near):
            break
        outward = closest - out[near]
        length = np.linalg.norm(outward, axis=1, keepdims=True)
        out[near] = closest + gap * outward / np.maximum(length, 1e-9)
    return out
