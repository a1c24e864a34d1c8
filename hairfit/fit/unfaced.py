"""Hair that no photograph faces: it goes on as it does on both sides.

Photographs from in front show nothing of the back of the head, where no mask excludes
hair. It is as high above the skin there as beside it at its level, and where there is
none on both sides, there is none between.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..capture.capture import View
from ..capture.cranium import find_cranium
from ..capture.distance import signed_distance
from ..render.raster import cells, project_points
from ..types import Mesh
from .grid import Grid
from .hull import Hull, hull_of

WAYS = 72  # around the head
# To the middles of these, in radians from the face to the left.
TURNS = (np.arange(WAYS) + 0.5) * (2.0 * np.pi / WAYS)
LEVEL = 0.006  # metres
FACED = np.radians(75.0)  # to both sides of a camera, up to which it faces the head
STEEP = np.radians(60.0)  # above the head, from which on a camera faces no side of it
TOP = 0.9  # quantile of the heights of a place's hair up to which there is hair


def with_unfaced(
    hull: Hull,
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    head: Mesh,
) -> Hull:
    """Return the hull with hair where no photograph faces the head.

    The same hull where some photograph faces every side.

    Args:
        hull: The hull that the masks allow.
        views: The photographs.
        depths: Depth of the head in each photograph, in metres.
        head: The head; +y up.
    """
    centre = find_cranium(head).centre
    unfaced = unfaced_ways(views, centre)
    if not unfaced.any() or unfaced.all():
        return hull
    level, way = places_around(hull.grid.centres(hull.hair), centre)
    lowest = level.min()
    high = highest(level - lowest, way, hull.head[hull.hair])
    at, beside = np.flatnonzero(unfaced), np.flatnonzero(~unfaced)
    for row in high:
        row[at] = np.interp(at, beside, row[beside], period=WAYS)
    room = _room_for(hull.grid, head, centre, unfaced, float(high.max()))
    hair = np.pad(hull.hair, room)
    # Until it is measured, as `Hull` has it far from hair.
    from_head = np.pad(hull.head, room, constant_values=0.02)
    spacing, before = hull.grid.spacing, np.array(room)[:, 0]
    grid = Grid(hull.grid.origin - spacing * before, spacing, hair.shape)
    index = np.argwhere(~hair)
    points = grid.centres(~hair)
    level, way = places_around(points, centre)
    inside = unfaced[way] & (level >= lowest) & (level < lowest + len(high))
    index, points = index[inside], points[inside]
    tall = high[level[inside] - lowest, way[inside]]
    free = np.ones(len(points), bool)
    for view, depth in zip(views, depths, strict=True):
        pixels = project_points(points, view.camera)
        y, x, seen = cells(pixels, view.camera.width, view.camera.height)
        free &= ~seen | view.hair[y, x] | (pixels.depth > depth[y, x])
    index, tall = index[free], tall[free]
    skin = signed_distance(head, points[free])
    from_head[tuple(index.T)] = skin
    hair[tuple(index[(skin > 0.0) & (skin < tall)].T)] = True
    return hull_of(grid, hair, from_head)


def unfaced_ways(
    views: Sequence[View], centre: Float[np.ndarray, " 3"]
) -> Bool[np.ndarray, " ways"]:
    """Return the ways from the middle of the head, around it, that no camera faces."""
    out = np.ones(WAYS, bool)
    for view in views:
        x, y, z = np.asarray(view.camera.centre, np.float64) - centre
        if np.arctan2(y, np.hypot(x, z)) < STEEP:
            out &= np.cos(TURNS - np.arctan2(x, z)) < np.cos(FACED)
    return out


def unfaced_side(views: Sequence[View], head: Mesh) -> str | None:
    """Return in words on which side of the head no photograph faces it, if on any."""
    unfaced = unfaced_ways(views, find_cranium(head).centre)
    if not unfaced.any():
        return None
    left, front = np.sin(TURNS[unfaced]).sum(), np.cos(TURNS[unfaced]).sum()
    if abs(left) > abs(front):
        side = "left" if left > 0.0 else "right"
    else:
        side = "front" if front > 0.0 else "back"
    return f"the {side} of the head, over {unfaced.mean() * 360.0:.0f} degrees"


class Places(NamedTuple):
    """Where points are around the head: the numbers of their levels and ways."""

    level: Int[np.ndarray, " points"]
    way: Int[np.ndarray, " points"]


def places_around(
    points: Float[np.ndarray, "points 3"], centre: Float[np.ndarray, " 3"]
) -> Places:
    """Return where points are around the middle of the head."""
    x, y, z = (points - centre).T
    turn = np.mod(np.arctan2(x, z), 2.0 * np.pi) * (WAYS / (2.0 * np.pi))
    return Places(np.floor(y / LEVEL).astype(int), turn.astype(int) % WAYS)


def highest(
    level: Int[np.ndarray, " voxels"],
    way: Int[np.ndarray, " voxels"],
    height: Float[np.ndarray, " voxels"],
) -> Float[np.ndarray, "levels ways"]:
    """Return how high hair is above the skin at each place, 0 where there is none.

    Args:
        level: Of each voxel of hair, from 0.
        way: Likewise.
        height: Above the skin, in metres.
    """
    place = level * WAYS + way
    order = np.lexsort((height, place))
    found, first, count = np.unique(place[order], return_index=True, return_counts=True)
    high = np.zeros((level.max() + 1) * WAYS)
    high[found] = height[order][first + (TOP * (count - 1)).astype(int)]
    return high.reshape(-1, WAYS)


def _room_for(
    grid: Grid,
    head: Mesh,
    centre: Float[np.ndarray, " 3"],
    unfaced: Bool[np.ndarray, " ways"],
    high: float,
) -> list[tuple[int, int]]:
    """Return how many voxels a grid lacks before and after it along each axis.

    So that it goes on so high beyond the unfaced sides' skin, in metres. Levels stay
    those of the hair that is seen.
    """
    low, top = grid.origin, grid.origin + grid.spacing * np.array(grid.shape)
    skin = np.asarray(head.vertices, np.float64)
    skin = skin[(skin[:, 1] > low[1]) & (skin[:, 1] < top[1])]
    skin = skin[unfaced[places_around(skin, centre).way]]
    if not len(skin):
        return [(0, 0)] * 3
    beyond = low - skin.min(axis=0) + high, skin.max(axis=0) + high - top
    lacks = np.maximum(np.ceil(np.stack(beyond, axis=1) / grid.spacing), 0).astype(int)
    lacks[1] = 0
    return [(before, after) for before, after in lacks.tolist()]
