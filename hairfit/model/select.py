"""Choosing clusters and control points [Kim02, section 4.6.3].

All of it is topology and runs on the host, outside `jit`. A selection of clusters is a
sorted array of their indices, so that `np.intersect1d` and `np.union1d` combine
selections; a selection of control points is a mask of one row a cluster.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .contour import ANGLES
from .tree import HairTree, children, depths_of

Pair = Sequence[float] | Float[np.ndarray, " 2"]
Point = Sequence[float] | Float[np.ndarray, " 3"] | Float[Array, " 3"]
Matrix = Float[np.ndarray, "3 4"] | Float[Array, "3 4"]


class Knot(NamedTuple):
    """One control point of a skeleton.

    Attributes:
        cluster: Index of its cluster.
        knot: Its index in the skeleton, 0 at the root.
    """

    cluster: int
    knot: int


class Seen(NamedTuple):
    """Points as a camera sees them.

    Attributes:
        pixel: Where they are, with the first pixel's centre at (0.5, 0.5); not a number
            behind the camera.
        depth: How far in front of it, in metres.
    """

    pixel: Float[np.ndarray, "*batch 2"]
    depth: Float[np.ndarray, "*batch"]


def project(image_from_world: Matrix, points: Float[np.ndarray, "*batch 3"]) -> Seen:
    """Return where points are in a camera's picture.

    Args:
        image_from_world: The camera, `K @ cam_from_world[:3]`, whose last row gives the
            depth.
        points: Points in the world, in metres.
    """
    matrix = np.asarray(image_from_world, np.float64)
    at = np.asarray(points, np.float64) @ matrix[:, :3].T + matrix[:, 3]
    depth = at[..., 2]
    front = np.where(depth > 0.0, depth, np.nan)
    return Seen(at[..., :2] / front[..., None], depth)


def knots_in_sphere(
    tree: HairTree, centre: Point, radius: float
) -> Bool[np.ndarray, "clusters knots"]:
    """Return which control points lie in a sphere, its surface included.

    Args:
        tree: The tree.
        centre: Centre of the sphere, in metres.
        radius: Its radius, in metres.
    """
    away = control_points(tree) - np.asarray(centre, np.float64)
    return np.linalg.norm(away, axis=-1) <= radius


def knots_in_rectangle(
    tree: HairTree, image_from_world: Matrix, low: Pair, high: Pair
) -> Bool[np.ndarray, "clusters knots"]:
    """Return which control points a camera sees in a rectangle of its picture.

    What lies in front of the camera counts, hidden or not.

    Args:
        tree: The tree.
        image_from_world: The camera, as `project` takes it.
        low: The smallest column and row, in pixels.
        high: The largest ones.
    """
    pixel = project(image_from_world, control_points(tree)).pixel
    return within(pixel, low, high)


def clusters_of(
    knots: Bool[np.ndarray, "clusters knots"], *, whole: bool = False
) -> Int[np.ndarray, " some"]:
    """Return the clusters with some control point chosen, or all with `whole`."""
    return np.flatnonzero(knots.all(axis=1) if whole else knots.any(axis=1))


def nearest_knot(
    tree: HairTree, p: Point, among: Int[np.ndarray, " some"] | None = None
) -> Knot:
    """Return the control point that is closest to a point of the world.

    Of equal distances the first counts.

    Args:
        tree: The tree.
        p: The point, in metres.
        among: The clusters to pick from, None for all.

    Raises:
        ValueError: If there is no cluster to pick from.
    """
    away = control_points(tree) - np.asarray(p, np.float64)
    found = least(np.linalg.norm(away, axis=-1), among)
    if found is None:
        raise ValueError("there is no cluster to pick a control point from.")
    return found


def pick_knot(
    tree: HairTree,
    image_from_world: Matrix,
    pixel: Pair,
    reach: float = 8.0,
    among: Int[np.ndarray, " some"] | None = None,
) -> Knot | None:
    """Return the control point that is picked in a camera's picture, if any.

    It is the one that the camera sees closest to the pixel. Of control points within
    half a pixel of that distance the one in front is picked, as siblings share places.

    Args:
        tree: The tree.
        image_from_world: The camera, as `project` takes it.
        pixel: Column and row.
        reach: How far away from `pixel` it may be, in pixels.
        among: The clusters to pick from, None for all.
    """
    seen = project(image_from_world, control_points(tree))
    away = np.linalg.norm(seen.pixel - np.asarray(pixel, np.float64), axis=-1)
    away = np.where(away <= reach, away, np.inf)  # false for what is behind
    closest = least(away, among)
    if closest is None:
        return None
    as_close = away <= away[closest] + 0.5
    return least(np.where(as_close, seen.depth, np.inf), among)


def clusters_in_rectangle(
    tree: HairTree, low: Pair, high: Pair, *, whole: bool = False
) -> Int[np.ndarray, " some"]:
    """Return the clusters that are rooted in a rectangle of scalp space.

    Args:
        tree: The tree.
        low: The smallest (u, v).
        high: The largest (u, v).
        whole: Whether all of a cluster's scalp contour must be inside, at its 32
            angles, or only its centre.
    """
    return np.flatnonzero(within(scalp_places(tree, whole), low, high).all(axis=1))


def clusters_in_polygon(
    tree: HairTree,
    corners: Sequence[Pair] | Float[np.ndarray, "corners 2"],
    *,
    whole: bool = False,
) -> Int[np.ndarray, " some"]:
    """Return the clusters that are rooted in a polygon of scalp space, as by a lasso.

    Inside is what the polygon goes around an odd number of times. A point on its border
    may count as in or out, but never as both in two polygons that share the border.

    Args:
        tree: The tree.
        corners: (u, v) of the corners in order; the last one is joined to the first.
        whole: As in `clusters_in_rectangle`. Between its 32 angles a contour may leave
            the polygon unseen, where that has a corner that points inwards.

    Raises:
        ValueError: If there are fewer than three corners.
    """
    a = np.asarray(corners, np.float64).reshape(-1, 2)
    if len(a) < 3:
        raise ValueError(f"a polygon needs at least 3 corners, got {len(a)}.")
    b = np.roll(a, -1, axis=0)
    place = scalp_places(tree, whole)[..., None, :]
    # A ray towards larger u crosses the edges that straddle it on that side.
    straddles = (a[:, 1] > place[..., 1]) != (b[:, 1] > place[..., 1])
    rise = np.where(a[:, 1] == b[:, 1], 1.0, b[:, 1] - a[:, 1])
    crossing = a[:, 0] + (place[..., 1] - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
    crossings = (straddles & (place[..., 0] < crossing)).sum(axis=-1)
    return np.flatnonzero((crossings % 2 == 1).all(axis=1))


def clusters_above(tree: HairTree, depth: int) -> Int[np.ndarray, " some"]:
    """Return the clusters of less than a depth; root clusters have depth 0."""
    return np.flatnonzero(depths_of(tree.parent) < depth)


def parent_of(tree: HairTree, index: int) -> int:
    """Return a cluster's parent; a root cluster is where the walk stays."""
    above = tree.parent[known(tree, index)]
    return index if above < 0 else above


def first_child(tree: HairTree, index: int) -> int:
    """Return a cluster's first child; a leaf is where the walk stays."""
    below = children(tree, known(tree, index))
    return int(below[0]) if len(below) else index


def next_sibling(tree: HairTree, index: int) -> int:
    """Return the next child of the same parent; after the last comes the first.

    Root clusters are siblings. An only child is its own sibling.
    """
    return sibling(tree, index, 1)


def previous_sibling(tree: HairTree, index: int) -> int:
    """Return the child before of the same parent; before the first comes the last."""
    return sibling(tree, index, -1)


def sibling(tree: HairTree, index: int, step: int) -> int:
    """Return the sibling some steps further, around and around."""
    all_of_them = children(tree, tree.parent[known(tree, index)])
    here = int(np.searchsorted(all_of_them, index))
    return int(all_of_them[(here + step) % len(all_of_them)])


def known(tree: HairTree, index: int) -> int:
    """Return the index of a cluster if the tree has it."""
    if not 0 <= index < tree.count:
        raise ValueError(
            f"there is no cluster {index}; a tree of {tree.count} clusters has 0 to "
            f"{tree.count - 1}."
        )
    return index


def control_points(tree: HairTree) -> Float[np.ndarray, "clusters knots 3"]:
    """Return the control points of all skeletons."""
    return np.asarray(tree.cylinder.skeleton, np.float64)


def scalp_places(tree: HairTree, whole: bool) -> Float[np.ndarray, "clusters places 2"]:
    """Return the centres of all scalp contours, or the contours at their 32 angles."""
    centre = np.asarray(tree.contour.centre, np.float64)[:, None]
    if not whole:
        return centre
    angle = np.arange(ANGLES) * (2.0 * np.pi / ANGLES)
    spoke = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    reach = np.asarray(tree.contour.radius)[:, None] + np.asarray(tree.contour.offset)
    return centre + reach[..., None] * spoke


def within(
    places: Float[np.ndarray, "*batch 2"], low: Pair, high: Pair
) -> Bool[np.ndarray, "*batch"]:
    """Return which places lie in a rectangle, its border included."""
    above, below = np.asarray(low, np.float64), np.asarray(high, np.float64)
    return np.all((places >= above) & (places <= below), axis=-1)


def least(
    value: Float[np.ndarray, "clusters knots"],
    among: Int[np.ndarray, " some"] | None,
) -> Knot | None:
    """Return the control point of the least finite value, the first of equals."""
    rows = np.arange(len(value)) if among is None else np.asarray(among, int)
    some = value[rows]
    if not np.isfinite(some).any():
        return None
    row, knot = np.unravel_index(np.argmin(some), some.shape)
    return Knot(int(rows[row]), int(knot))
