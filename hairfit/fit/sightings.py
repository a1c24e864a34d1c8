"""What photographs tell of hair, as information on the knots of its clusters.

A piece of a strand moves with the two knots between which it lies: its place by their
moves, its direction by the difference of these. What a photograph measures of it, an
angle or a distance from an outline, is one row of the Jacobian over six numbers. Rows
are kept as sums of $J^T J / variance$ for each stretch between two knots, as means over
its pieces, seen or not: neighbouring pieces err together, so a stretch counts once for
each photograph, and less where only a part of its hair is seen.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from ..capture.capture import View
from ..capture.orientation import SIGMA_BLIND, OrientationMap
from ..render.raster import Cells, Pixels, cells, project_points

# Hair this near to the outline of all hair is seen against what lies behind. Metres.
NEAR_OUTLINE = 0.003
SIGMA_OUTLINE = 0.002
# Where hair points at the camera its picture says no more than at this sine.
LEAST_SINE = 0.3
# The change of the angle over a picture is that of its mean over so many pixels.
SMOOTH_PX = 4.0


class Pieces(NamedTuple):
    """Segments of strands, and which knots of their clusters move them.

    Attributes:
        middle: Their middles, in metres.
        tangent: Their directions.
        speed: Metres of strand for one stretch from knot to knot.
        strand: The strand of each.
        owner: Its cluster.
        stretch: The knot before it.
        share: How far it is on the way from that knot to the next, 0 to 1.
        clusters: Number of clusters.
        stretches: Number of stretches of a cluster, one less than its knots.
    """

    middle: Float[np.ndarray, "pieces 3"]
    tangent: Float[np.ndarray, "pieces 3"]
    speed: Float[np.ndarray, " pieces"]
    strand: Int[np.ndarray, " pieces"]
    owner: Int[np.ndarray, " pieces"]
    stretch: Int[np.ndarray, " pieces"]
    share: Float[np.ndarray, " pieces"]
    clusters: int
    stretches: int

    def some(self, index: np.ndarray) -> "Pieces":
        """Return the pieces at `index`."""
        return self._replace(
            middle=self.middle[index],
            tangent=self.tangent[index],
            speed=self.speed[index],
            strand=self.strand[index],
            owner=self.owner[index],
            stretch=self.stretch[index],
            share=self.share[index],
        )

    def totals(
        self, values: Float[np.ndarray, "pieces 3 3"]
    ) -> Float[np.ndarray, "clusters stretches 3 3"]:
        """Return the sums of symmetric matrices over the pieces of each stretch."""
        out = np.zeros((self.clusters, self.stretches, 3, 3))
        for i in range(3):
            for j in range(i + 1):
                out[..., i, j] = out[..., j, i] = self.total(values[:, i, j])
        return out

    def total(
        self, values: Float[np.ndarray, " pieces"]
    ) -> Float[np.ndarray, "clusters stretches"]:
        """Return the sums of values over the pieces of each stretch."""
        shape = self.clusters, self.stretches
        row = self.owner * self.stretches + self.stretch
        return np.bincount(row, values, shape[0] * shape[1]).reshape(shape)


class Rows(NamedTuple):
    """Measurements, one a piece: their change with both knots' moves, and variance."""

    slope: Float[np.ndarray, "pieces 6"]
    variance: Float[np.ndarray, " pieces"]


class Told(NamedTuple):
    """What photographs tell.

    Attributes:
        info: Sums of information on the moves of the two knots of each stretch.
        square: Sum over a cluster's seen pieces of the squared error of an angle, that
            which its photograph expects and that which the strand has.
        count: Number of these pieces.
    """

    info: Float[np.ndarray, "clusters stretches 6 6"]
    square: Float[np.ndarray, " clusters"]
    count: Float[np.ndarray, " clusters"]


def pieces_of(
    strands: Float[np.ndarray, "strands points 3"],
    owner: Int[np.ndarray, " strands"],
    clusters: int,
    knots: int,
) -> Pieces:
    """Return the segments of strands whose points are even along their clusters."""
    count, points = strands.shape[:2]
    step = np.diff(strands, axis=1)
    length = np.linalg.norm(step, axis=2)
    at = (np.arange(points - 1) + 0.5) / (points - 1) * (knots - 1)
    stretch = np.minimum(at.astype(int), knots - 2)
    return Pieces(
        middle=(0.5 * (strands[:, 1:] + strands[:, :-1])).reshape(-1, 3),
        tangent=(step / np.maximum(length, 1e-9)[..., None]).reshape(-1, 3),
        speed=np.maximum(length * (points - 1) / (knots - 1), 1e-6).reshape(-1),
        strand=np.repeat(np.arange(count), points - 1),
        owner=np.repeat(np.asarray(owner, int), points - 1),
        stretch=np.tile(stretch, count),
        share=np.tile(at - stretch, count),
        clusters=clusters,
        stretches=knots - 1,
    )


def outline_distance(view: View) -> Float[np.ndarray, "height width"]:
    """Return how many pixels each is inside the hair's mask, negative outside."""
    inside = np.asarray(ndimage.distance_transform_edt(view.hair))
    outside = np.asarray(ndimage.distance_transform_edt(~view.hair))
    # From pixel to pixel, while the outline lies half way between them.
    return np.where(view.hair, inside - 0.5, 0.5 - outside)


def tell(
    pieces: Pieces,
    view: View,
    found: OrientationMap,
    within: Float[np.ndarray, "height width"],
    seen: Bool[np.ndarray, " pieces"],
) -> Told:
    """Return what one photograph tells of the pieces that it shows.

    Args:
        pieces: All pieces.
        view: The photograph.
        found: Its orientation map.
        within: Its `outline_distance`.
        seen: Which pieces it shows.
    """
    land = project_points(pieces.middle, view.camera)
    at = cells(land, view.camera.width, view.camera.height)
    index = np.flatnonzero(seen & at.inside)
    pieces = pieces.some(index)
    land = Pixels(land.pixel[index], land.depth[index])
    at = Cells(*(array[index] for array in at))
    shift = pixel_slopes(pieces.middle, view)
    angle = angle_rows(pieces, view, found, shift, at)
    known = found.confidence[at.row, at.column] > 0
    outline = outline_rows(pieces, view, within, shift, land.depth, at)
    owner, clusters = pieces.owner, pieces.clusters
    return Told(
        information(pieces, angle, known) + information(pieces, *outline),
        np.bincount(owner, known * angle.variance, clusters),
        np.bincount(owner, known, clusters),
    )


def pixel_slopes(
    points: Float[np.ndarray, "points 3"], view: View
) -> Float[np.ndarray, "points 2 3"]:
    """Return how far the pictures of points move, in pixels a metre of the world."""
    pose = np.asarray(view.camera.cam_from_world, np.float64)
    p_cam = points @ pose[:3, :3].T + pose[:3, 3]
    slope = np.zeros((len(points), 2, 3))
    slope[:, 0, 0] = slope[:, 1, 1] = 1.0
    slope[:, :, 2] = -p_cam[:, :2] / p_cam[:, 2:]
    intrinsic = np.asarray(view.camera.K, np.float64)[:2, :2]
    return intrinsic @ slope @ pose[:3, :3] / p_cam[:, 2, None, None]


def sight_lines(
    points: Float[np.ndarray, "points 3"], view: View
) -> Float[np.ndarray, "points 3"]:
    """Return the directions from a camera to points."""
    pose = np.asarray(view.camera.cam_from_world, np.float64)
    ray = points + pose[:3, :3].T @ pose[:3, 3]
    return ray / np.linalg.norm(ray, axis=1, keepdims=True)


def angle_rows(
    pieces: Pieces,
    view: View,
    found: OrientationMap,
    shift: Float[np.ndarray, "pieces 2 3"],
    at: Cells,
) -> Rows:
    """Return the angle of hair in the picture, against that of the photograph.

    It changes as the hair turns about the line of sight, and as it moves to where the
    photograph shows another angle: what two views that see it differ by. A photograph
    that the strand is at odds with is known less well by as much.
    """
    normal = np.cross(sight_lines(pieces.middle, view), pieces.tangent)
    sine = np.linalg.norm(normal, axis=1, keepdims=True)
    turn = normal / np.maximum(sine, 1e-6) / np.maximum(sine, LEAST_SINE)
    turn = turn / pieces.speed[:, None]
    there = angle_slopes(found)[at.row, at.column]
    drift = np.einsum("pi,pij->pj", there, shift)
    share = pieces.share[:, None]
    slope = np.hstack([-turn - (1.0 - share) * drift, turn - share * drift])
    line = np.einsum("pij,pj->pi", shift, pieces.tangent)
    off = np.arctan2(line[:, 1], line[:, 0]) - found.angle[at.row, at.column]
    off = np.mod(off + np.pi / 2, np.pi) - np.pi / 2
    return Rows(slope, found.sigma[at.row, at.column].astype(np.float64) ** 2 + off**2)


def angle_slopes(found: OrientationMap) -> Float[np.ndarray, "height width 2"]:
    """Return the change of the angle along x and y, in radians a pixel."""
    cosine, sine = (
        ndimage.gaussian_filter(found.confidence * part(2.0 * found.angle), SMOOTH_PX)
        for part in (np.cos, np.sin)
    )
    square = cosine**2 + sine**2 + 1e-4
    change = [
        cosine * np.gradient(sine, axis=axis) - sine * np.gradient(cosine, axis=axis)
        for axis in (1, 0)
    ]
    return np.stack(change, axis=-1) / (2.0 * square)[..., None]


class Outline(NamedTuple):
    """Rows of the pieces near an outline, and which these are."""

    rows: Rows
    near: Bool[np.ndarray, " pieces"]


def outline_rows(
    pieces: Pieces,
    view: View,
    within: Float[np.ndarray, "height width"],
    shift: Float[np.ndarray, "pieces 2 3"],
    depth: Float[np.ndarray, " pieces"],
    at: Cells,
) -> Outline:
    """Return the distance of hair from the outline of all hair, in metres.

    Only near it, where hair that is seen can hardly be elsewhere.
    """
    metres = depth / view.camera.focal
    away = within[at.row, at.column] * metres
    even = ndimage.gaussian_filter(within, 1.0)
    change = [np.gradient(even, axis=axis)[at.row, at.column] for axis in (1, 0)]
    change = np.stack(change, axis=-1) * metres[:, None]
    move = np.einsum("pi,pij->pj", change, shift)
    share = pieces.share[:, None]
    slope = np.hstack([(1.0 - share) * move, share * move])
    variance = SIGMA_OUTLINE**2 + np.minimum(away, 0.0) ** 2
    return Outline(Rows(slope, variance), np.abs(away) < NEAR_OUTLINE)


def information(
    pieces: Pieces, rows: Rows, use: Bool[np.ndarray, " pieces"]
) -> Float[np.ndarray, "clusters stretches 6 6"]:
    """Return the sums over each stretch of what some measurements tell."""
    weight = use / rows.variance
    out = np.zeros((pieces.clusters, pieces.stretches, 6, 6))
    for i in range(6):
        for j in range(i + 1):
            product = rows.slope[:, i] * rows.slope[:, j]
            out[..., i, j] = out[..., j, i] = pieces.total(weight * product)
    return out


def scatter(told: Told, even: int) -> Float[np.ndarray, " clusters"]:
    """Return the squared error of an angle that photographs see in each cluster.

    It does not shrink with the number of pieces: hair beside hair differs so, too. A
    cluster of which little is seen is held to be as all others are.

    Args:
        told: What all photographs tell.
        even: That many pieces of the mean over all count with each cluster's own.
    """
    total = told.count.sum()
    mean = told.square.sum() / total if total else SIGMA_BLIND**2
    return (told.square + even * mean) / (told.count + even)
