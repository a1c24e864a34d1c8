"""What is held of hair that no photograph shows: it runs as the hair around it does.

And it lies where masks leave room for it, the surer the deeper: what lies far inside of
all outlines has hair around it wherever the true surface is.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree
from scipy.special import ndtr

from ..capture.capture import View
from ..render.raster import cells, project_points
from .sightings import Pieces, sight_lines

NEIGHBOURS = 24
# Pairs of seen pieces are compared up to the last of these distances. Metres.
EDGES = np.array([0.001, 0.003, 0.006, 0.01, 0.015, 0.02, 0.03, 0.04, 0.06])
PROBES, PARTNERS = 2000, 64
FEWEST_PAIRS = 50
# The squared angle between lines of no relation, of each of its two directions.
UNRELATED = 0.5 * (np.pi - 2.0)


def turn_variance(
    pieces: Pieces, seen: Bool[np.ndarray, " pieces"]
) -> Float[np.ndarray, " pieces"]:
    """Return the squared error of a direction that is told from the hair around.

    In each of the two directions across, in radians: how far the pieces around differ,
    and what seen hair differs by at the distance of the nearest that is seen.
    """
    _, index = KDTree(pieces.middle).query(pieces.middle, k=min(NEIGHBOURS, len(seen)))
    other = pieces.strand[index] != pieces.strand[:, None]
    square = half_square(pieces.tangent[:, None], pieces.tangent[index])
    count = other.sum(axis=1)
    around = np.sum(other * square, axis=1) / np.maximum(count, 1)
    around = np.where(count > 0, around, UNRELATED)
    shown = np.flatnonzero(seen)
    if len(shown) < 2:
        return around + UNRELATED
    away = KDTree(pieces.middle[shown]).query(pieces.middle)[0]
    centre, grown = variogram(pieces.some(shown))
    return around + np.interp(away, centre, grown)


def half_square(
    first: Float[np.ndarray, "*#pairs 3"], second: Float[np.ndarray, "*#pairs 3"]
) -> Float[np.ndarray, "..."]:
    """Return half of the squared angle between lines."""
    cosine = np.abs(np.einsum("...x,...x->...", first, second))
    return 0.5 * np.arccos(np.minimum(cosine, 1.0)) ** 2


class Variogram(NamedTuple):
    """How directions differ with distance, beyond those side by side."""

    distance: Float[np.ndarray, " bins"]
    variance: Float[np.ndarray, " bins"]


def variogram(pieces: Pieces) -> Variogram:
    """Return how the directions of pieces differ with their distance, never falling.

    Without enough pairs at a distance it is not told apart from the next below.
    """
    rng = np.random.default_rng(0)
    some = rng.choice(len(pieces.middle), min(PROBES, len(pieces.middle)), False)
    close = KDTree(pieces.middle).query(
        pieces.middle[some], k=min(NEIGHBOURS, len(pieces.middle))
    )[1]
    far = rng.choice(len(pieces.middle), (len(some), PARTNERS))
    other = np.concatenate([close.reshape(len(some), -1), far], axis=1)
    gap = np.linalg.norm(pieces.middle[some][:, None] - pieces.middle[other], axis=2)
    square = half_square(pieces.tangent[some][:, None], pieces.tangent[other])
    count = np.histogram(gap, EDGES)[0]
    total = np.histogram(gap, EDGES, weights=square)[0]
    enough = count >= FEWEST_PAIRS
    if not enough.any():
        return Variogram(np.zeros(1), np.full(1, UNRELATED))
    middle = 0.5 * (EDGES[1:] + EDGES[:-1])[enough]
    value = np.maximum.accumulate(total[enough] / count[enough])
    return Variogram(np.append(0.0, middle), np.append(0.0, value - value[0]))


def place_variance(
    deep: Float[np.ndarray, " pieces"], sigma: float, spacing: float
) -> Float[np.ndarray, " pieces"]:
    r"""Return the squared distance to the next hair, as masks have it, in metres.

    The true surface of the hair lies $|e|$ below what masks leave, $e$ normal with the
    standard deviation `sigma`. Above it the next hair is at the surface, below it a
    spacing away. So at the depth $d = x \sigma$ the expectation is
    $2 \sigma^2 ((1 + x^2) \Phi(-x) - x \varphi(x))$ and the spacing squared.

    Args:
        deep: Depth of each piece below what masks leave, negative outside, infinite
            where nothing is known.
        sigma: How far the surface is off.
        spacing: Distance of hairs inside.
    """
    known = np.isfinite(deep)
    depth = np.where(known, deep, 0.0)
    x = np.maximum(depth, 0.0) / sigma
    density = np.exp(-0.5 * x**2) / np.sqrt(2.0 * np.pi)
    within = 2.0 * sigma**2 * ((1.0 + x**2) * ndtr(-x) - x * density)
    outside = np.minimum(depth, 0.0) ** 2
    variance = np.maximum(within, 0.0) + outside + spacing**2
    return np.where(known, variance, np.inf)


class Room(NamedTuple):
    """What masks leave for hair around pieces of it.

    Attributes:
        deep: Least distance to an outline in any view, in metres, negative outside of a
            mask; infinite where the head hides a piece from all views.
        across: Share of the views that bound where it lies, in each direction: none
            does along its own line of sight.
    """

    deep: Float[np.ndarray, " pieces"]
    across: Float[np.ndarray, "pieces 3 3"]


def find_room(
    pieces: Pieces,
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    within: Sequence[Float[np.ndarray, "_height _width"]],
) -> Room:
    """Return what masks leave for hair around pieces of it.

    Args:
        pieces: The pieces.
        views: The photographs.
        depths: Depth of the head in them, in metres.
        within: Their `outline_distance`.
    """
    count = len(pieces.middle)
    deep, across = np.full(count, np.inf), np.zeros((count, 3, 3))
    views_of = np.zeros(count)
    for view, behind, inside in zip(views, depths, within, strict=True):
        land = project_points(pieces.middle, view.camera)
        at = cells(land, view.camera.width, view.camera.height)
        free = at.inside & (land.depth < behind[at.row, at.column])
        metres = inside[at.row, at.column] * land.depth / view.camera.focal
        deep = np.where(free, np.minimum(deep, metres), deep)
        ray = sight_lines(pieces.middle, view)
        open_ = np.eye(3) - ray[:, :, None] * ray[:, None]
        across += free[:, None, None] * open_
        views_of += free
    return Room(deep, across / np.maximum(views_of, 1.0)[:, None, None])
