"""Where the cranium of a head is, and what a ray from its centre meets."""

import functools
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..types import Mesh

# Sizes of an adult head; other heads are scaled by their width. Metres.
WIDTH = 0.152
CENTRE_BELOW_TOP = 0.10
FARTHEST = 0.16
# The polar axis leans back, so that circles about it follow the hairline. Radians.
TILT = np.radians(20.0)
# How far squares swell to discs; at 0.5 all the way.
BULGE = 0.42


class Cranium(NamedTuple):
    """A polar frame in the head: +y up and +z to the face, as in the world.

    Attributes:
        centre: The centre of the cranium, in metres.
        axes: Rows: to the person's left, to the face, and the polar axis.
        size: Width of the cranium over that of an adult.
    """

    centre: Float[np.ndarray, " 3"]
    axes: Float[np.ndarray, "3 3"]
    size: float

    def direction(
        self, polar: Float[np.ndarray, " rays"], azimuth: Float[np.ndarray, " rays"]
    ) -> Float[np.ndarray, "rays 3"]:
        """Return unit directions; azimuth 0 is the face, pi/2 the person's left."""
        flat = np.sin(polar)[:, None] * (
            np.sin(azimuth)[:, None] * self.axes[0]
            + np.cos(azimuth)[:, None] * self.axes[1]
        )
        return flat + np.cos(polar)[:, None] * self.axes[2]


class Disc(NamedTuple):
    """Points of a disc."""

    x: Float[np.ndarray, "*points"]
    y: Float[np.ndarray, "*points"]


def square_to_disc(
    a: Float[np.ndarray, "*points"], b: Float[np.ndarray, "*points"]
) -> Disc:
    """Map the square [-1, 1]^2 nearly onto the unit disc.

    A little less than a full disc: at its corners a full one has no normal.
    """
    return Disc(a * np.sqrt(1.0 - BULGE * b**2), b * np.sqrt(1.0 - BULGE * a**2))


def disc_to_square(
    x: Float[np.ndarray, " points"], y: Float[np.ndarray, " points"]
) -> Float[np.ndarray, "points 2"]:
    """Return where in the square `square_to_disc` takes to points of the disc.

    With the squares A and B of the coordinates, A (1 - c B) = x^2 and B (1 - c A) = y^2
    give a quadratic equation. Points beyond the disc go to the square's border.
    """
    k = 1.0 - BULGE * x**2 + BULGE * y**2
    root = np.sqrt(np.maximum(k * k - 4.0 * BULGE * y**2, 0.0))
    b2 = (k - root) / (2.0 * BULGE)
    a2 = x**2 / np.maximum(1.0 - BULGE * b2, 1e-6)
    square = np.sqrt(np.stack([a2, b2], axis=1)) * np.sign(np.stack([x, y], axis=1))
    return np.clip(square, -1.0, 1.0)


def find_cranium(head: Mesh) -> Cranium:
    """Return the polar frame of a head, found from the top of its mesh."""
    vertices = head.vertices
    top = vertices[:, 1].max()
    size = 1.0
    low = high = vertices[0]
    for _ in range(3):
        cap = vertices[vertices[:, 1] > top - 1.1 * CENTRE_BELOW_TOP * size]
        low, high = np.percentile(cap, 1, axis=0), np.percentile(cap, 99, axis=0)
        size = float(np.clip((high[0] - low[0]) / WIDTH, 0.5, 2.0))
    centre = (low + high) / 2
    centre[1] = top - CENTRE_BELOW_TOP * size
    axes = np.array(
        [
            [1.0, 0.0, 0.0],
            [0.0, np.sin(TILT), np.cos(TILT)],
            [0.0, np.cos(TILT), -np.sin(TILT)],
        ]
    )
    return Cranium(centre, axes, size)


@functools.cache
def even_directions(count: int, lowest: float) -> Float[np.ndarray, "directions 3"]:
    """Return unit directions spread evenly, by the golden angle, down to a height.

    Args:
        count: How many.
        lowest: Height up to which they go down: 0 for half of a sphere, -1 for all.
    """
    up = lowest + (1.0 - lowest) * (np.arange(count) + 0.5) / count
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    out = np.sqrt(1.0 - up**2)
    return np.stack([out * np.cos(turn), up, out * np.sin(turn)], axis=1)


def skin_distance(
    head: Mesh, cranium: Cranium, directions: Float[np.ndarray, "rays 3"]
) -> Float[np.ndarray, " rays"]:
    """Return how far the outermost skin is from the cranium's centre along each ray.

    Rays that meet nothing, or only shoulders, get the median of the others.
    """
    import trimesh

    mesh = trimesh.Trimesh(head.vertices, head.faces, process=False)
    origins = np.broadcast_to(cranium.centre, directions.shape)
    hits, rays, _ = mesh.ray.intersects_location(origins, directions)
    away = np.linalg.norm(hits - cranium.centre, axis=1)
    near = away < FARTHEST * cranium.size
    distance = np.zeros(len(directions))
    np.maximum.at(distance, rays[near], away[near])
    met = distance > 0
    distance[~met] = np.median(distance[met])
    return distance
