"""The hull where views contradict each other, which no mask tells: there is no hair.

Where three views or more see a voxel of hair, their planes meet in one line. Before the
hair, where the hull is too wide, each view sees other hair behind it, and the planes
disagree. Carving by photo-consistency (Kutulakos & Seitz 2000), with the direction of
hair in place of its colour, which changes with the view.
"""

import dataclasses
from collections.abc import Sequence
from functools import partial

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..capture.orientation import (
    SIGMA_BLIND,
    SIGMA_SURE,
    OrientationMap,
    spread_of_lines,
)
from .curls import mean_line
from .evidence import find_planes, full_matrix
from .grid import blurred
from .hull import Hull, hull_of, pixel_sizes, walls_of

INCONSISTENT = 1.5  # disagreement over the expected one from which on there is no hair
AROUND = 0.006  # metres: one voxel says little, those around it decide together
DEEP = 0.015  # metres within the surface in which voxels are asked
LEAST_KNOWN = 0.05  # share of the voxels around that three views must see
LEAST_FREEDOM = 0.1  # views beyond the two that always agree
BESIDE = 0.001  # metres by which hair may lie beside a place
SWEEPS = 8
FEWEST_CUT = 0.002  # of the hull; a sweep that cuts less is the last


def carve_by_direction(
    hull: Hull,
    views: Sequence[View],
    maps: Sequence[OrientationMap],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    curly: bool = False,
) -> Hull:
    """Return the hull without the voxels at its surface at which planes disagree.

    Layer by layer: what is behind a voxel is seen by more views once it is gone.

    Args:
        hull: The hull that the masks allow.
        views: The photographs.
        maps: Their orientation maps.
        depths: Depth of the head in each photograph, in metres.
        curly: Whether hair curls: then a place's direction is that of hair beside it.
    """
    if len(views) < 3:
        return hull
    if curly:
        pixels = pixel_sizes(hull, views)
        maps = list(abreast(unsure_of_place, [v.hair for v in views], maps, pixels))
    for _ in range(SWEEPS):
        solid = np.asarray(ndimage.binary_erosion(hull.hair | (hull.head < 0)), bool)
        surface = hull.hair & ~solid
        cut = surface & (disagreement(hull, views, maps, depths) > INCONSISTENT)
        left = hull.hair & ~cut
        # No hull is worse than one that is too wide; what is whole is measured already.
        if not left.any() or not cut.any():
            break
        hull = hull_of(hull.grid, left, hull.head)
        if cut.sum() < FEWEST_CUT * left.sum():
            break
    return hull


def unsure_of_place(
    hair: Bool[np.ndarray, "height width"], found: OrientationMap, pixel: float
) -> OrientationMap:
    """Return a map whose error is also that of hair a little beside the place.

    Which hair a voxel holds is known no better than that: where hair curls, other views
    see another part of the turn.

    Args:
        hair: Which pixels are hair.
        found: The orientation map.
        pixel: Width of a pixel, in metres.
    """
    mean = mean_line(hair, found, pixel, BESIDE)
    turns = spread_of_lines(np.hypot(mean[..., 0], mean[..., 1]))
    sigma = np.minimum(np.hypot(found.sigma, turns), SIGMA_BLIND)
    less = np.maximum(found.sigma, SIGMA_SURE) / np.maximum(sigma, SIGMA_SURE)
    return dataclasses.replace(
        found,
        confidence=(found.confidence * less**2).astype(np.float32),
        sigma=sigma.astype(np.float32),
    )


def disagreement(
    hull: Hull,
    views: Sequence[View],
    maps: Sequence[OrientationMap],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
) -> Float[np.ndarray, "x y z"]:
    r"""Return how far planes are from one line, over what their errors explain.

    The least eigenvalue of $\sum w\,n n^T$ is the sum of the weighted squares of the
    planes' angles to the best line. A view's angle errs by $\sigma$ and has the weight
    $w \propto \sigma^{-2}$, so each contributes the same; two of $n$ views are fitted.
    About 1 where there is hair; 0 where fewer than three views look, and deep inside.
    """
    near = hull.hair & (hull.distance > -DEEP)
    points = hull.grid.centres(near)
    entries = np.zeros((len(points), 6))
    seen, square = np.zeros(len(points)), np.zeros(len(points))
    told = partial(find_planes, walls_of(hull), points)
    for plane in abreast(told, views, maps, depths):
        entries += plane.entries
        says = np.where(plane.confidence > 0, plane.seen, 0.0)
        seen += says
        square += says**2
    least = np.maximum(np.linalg.eigvalsh(full_matrix(entries))[:, 0], 0.0)
    looking = seen**2 / np.maximum(square, 1e-12)
    expected = np.maximum(1.0 - 2.0 / np.maximum(looking, 2.0), 0.0) * seen
    asked = expected > LEAST_FREEDOM
    around = AROUND / hull.grid.spacing
    sums = np.where(asked, least, 0.0), np.where(asked, expected, 0.0), 1.0 * asked
    least, expected, known = abreast(lambda one: blurred(near, one, around), sums)
    expected *= SIGMA_SURE**2
    return np.where(known > LEAST_KNOWN, least / np.maximum(expected, 1e-12), 0.0)
