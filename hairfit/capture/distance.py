"""Signed distance to a head: negative inside it, also for open meshes."""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..model.collide import DistanceField, sample_field
from ..types import Mesh

CELL = 0.010  # metres, of the grid that tells what is near the skin
ROUNDING = 1e-6  # metres: distances on a grid are kept as float32


class Nearest(NamedTuple):
    """The skin nearest to points.

    Attributes:
        distance: Distance in metres, negative inside the head.
        closest: The closest points of the mesh.
    """

    distance: Float[np.ndarray, " points"]
    closest: Float[np.ndarray, "points 3"]


class Skin:
    """The skin of a head, prepared for many questions about what is near it.

    Inside is where the generalized winding number (Jacobson et al. 2013, by the fast
    form of Barill et al. 2018) exceeds one half, so that an open neck or overlapping
    parts do no harm.
    """

    def __init__(self, head: Mesh):
        import igl

        self.head = head
        self._vertices = np.ascontiguousarray(head.vertices, np.float64)
        self._faces = np.ascontiguousarray(head.faces, np.int64)
        self._tree = igl.AABB()
        self._tree.init(self._vertices, self._faces)
        self._winding = igl.FastWindingNumberBVH()
        self._winding.init(self._vertices, self._faces)

    def nearest(self, points: Float[np.ndarray, "points 3"]) -> Nearest:
        """Return the signed distance of points, in metres, and the closest points."""
        points = np.ascontiguousarray(points, np.float64)
        square, _, closest = self._tree.squared_distance(
            self._vertices, self._faces, points
        )
        # A mesh turned inside out holds the same head.
        winding = np.abs(np.atleast_1d(self._winding.winding_number(points)))
        distance = np.sqrt(np.atleast_1d(square))
        return Nearest(
            np.where(winding > 0.5, -distance, distance),
            np.asarray(closest).reshape(-1, 3),
        )

    @functools.cached_property
    def field(self) -> DistanceField:
        """Distances on a coarse grid that reaches beyond the head."""
        return head_field(self.head, CELL)

    def least_distance(
        self, points: Float[np.ndarray, "points 3"]
    ) -> Float[np.ndarray, " points"]:
        """Return what the signed distance of points is at least, in metres.

        It changes by no more than one walks from any corner of the grid's cell. A
        look-up so spares the exact distance of all that is not near the skin.
        """
        cell, origin = float(self.field.cell), np.asarray(self.field.origin, np.float64)
        values = np.asarray(self.field.distance, np.float64)
        last = np.array(values.shape) - 1
        place = (points - origin) / cell
        first = np.clip(np.floor(place), 0, last - 1).astype(int)
        square = [(place - first) ** 2, (place - first - 1) ** 2]
        least = np.full(len(points), -np.inf)
        for corner in np.ndindex(2, 2, 2):
            x, y, z = first.T + np.array(corner)[:, None]
            walk = sum(square[side][:, axis] for axis, side in enumerate(corner))
            least = np.maximum(least, values[x, y, z] - cell * np.sqrt(walk))
        beyond = np.linalg.norm(place - np.clip(place, 0, last), axis=1)
        # The head lies inside the grid.
        return np.where(beyond > 0, cell * beyond, least - ROUNDING)


def signed_distance(
    head: Mesh, points: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, " points"]:
    """Return the distance of points to a mesh in metres, negative inside it."""
    return Skin(head).nearest(points).distance


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


def push_out(
    skin: Skin, points: Float[np.ndarray, "points 3"], gap: float
) -> Float[np.ndarray, "points 3"]:
    """Return the points, those inside the head laid `gap` metres above its skin.

    Args:
        skin: The head's skin.
        points: Points, in metres.
        gap: Distance from the skin of what was inside.
    """
    out = points.copy()
    near = np.flatnonzero(skin.least_distance(points) < 0)
    for _ in range(3):
        distance, closest = skin.nearest(out[near])
        inside = distance < 0
        near, closest = near[inside], closest[inside]
        if not len(near):
            break
        outward = closest - out[near]
        length = np.linalg.norm(outward, axis=1, keepdims=True)
        out[near] = closest + gap * outward / np.maximum(length, 1e-9)
    return out
