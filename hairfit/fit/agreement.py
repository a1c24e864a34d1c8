"""Which hair masks agree: what the hull of some leaves unexplained in others.

A pixel of hair is unexplained if its ray meets no voxel that the other photographs
allow. The masks of one person agree whichever photographs carve: if one of them is
wrong, or its camera, they agree only without it.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..capture.cranium import find_cranium
from ..render.raster import cells, project_points
from ..types import Mesh
from .grid import Grid, in_coarser
from .hull import REACH, allowed_voxels, witnessed

SPACING = 0.008  # metres
COARSE = 0.024  # metres
SLACK = 1  # pixels by which a mask is grown before it carves


class Sight(NamedTuple):
    """What one photograph says of every voxel.

    Attributes:
        cell: Index of the pixel in which the voxel's centre lies.
        seen: It lies in the picture.
        hair: It does, before the head, in the hair.
        against: It does, before the head, beside the hair.
        reach: Half of a voxel's edge, in pixels.
    """

    cell: Int[np.ndarray, " voxels"]
    seen: Bool[np.ndarray, " voxels"]
    hair: Bool[np.ndarray, " voxels"]
    against: Bool[np.ndarray, " voxels"]
    reach: int


def find_candidates(
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    head: Mesh,
    spare: int,
) -> Float[np.ndarray, "voxels 3"]:
    """Return the centres of voxels that no more than `spare` views exclude, in metres.

    Args:
        views: The photographs, shrunken.
        depths: Depth of the head in them, in metres.
        head: The head.
        spare: So many views may be wrong.
    """
    cranium = find_cranium(head)
    focal = max(view.camera.focal for view in views)
    coarse = Grid.around(cranium.centre - REACH, cranium.centre + REACH, COARSE)
    everywhere = np.ones(coarse.shape, bool)
    allowed = allowed_voxels(
        coarse, everywhere, views, depths, COARSE * focal, spare=spare
    )
    if not allowed.any():
        return np.zeros((0, 3))
    found = coarse.centres(allowed)
    allowed = np.asarray(ndimage.binary_dilation(allowed), bool)
    grid = Grid.around(found.min(axis=0) - COARSE, found.max(axis=0) + COARSE, SPACING)
    near = in_coarser(grid, coarse, allowed)
    fine = allowed_voxels(grid, near, views, depths, SPACING * focal, spare=spare)
    return grid.centres(fine)


def look_at(
    points: Float[np.ndarray, "voxels 3"],
    view: View,
    depth: Float[np.ndarray, "height width"],
) -> Sight:
    """Return what a photograph says of voxels.

    Args:
        points: The voxels' centres, in metres.
        view: The photograph.
        depth: Depth of the head in it, in metres.
    """
    camera = view.camera
    pixels = project_points(points, camera)
    row, column, seen = cells(pixels, camera.width, camera.height)
    grown = ndimage.maximum_filter(view.hair, size=2 * SLACK + 1)
    hair = np.asarray(grown, bool)[row, column]
    free = seen & (pixels.depth <= depth[row, column])
    middle = float(np.median(pixels.depth)) if len(points) else 1.0
    reach = int(np.ceil(0.5 * SPACING * camera.focal / max(middle, 0.05)))
    return Sight(row * camera.width + column, seen, free & hair, free & ~hair, reach)


def ask_all(
    points: Float[np.ndarray, "voxels 3"],
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
) -> list[Sight]:
    """Return what each photograph says of voxels."""
    return list(abreast(partial(look_at, points), views, depths))


def hull_without(
    sights: Sequence[Sight], views: Sequence[View], without: Sequence[int]
) -> Bool[np.ndarray, " voxels"]:
    """Return the voxels that all photographs but some allow, as `carve` has it."""
    left = [k for k in range(len(views)) if k not in without]
    pictures = np.sum([sights[k].seen for k in left], axis=0)
    against = np.any([sights[k].against for k in left], axis=0)
    shown = np.stack([sights[k].hair for k in left], axis=1)
    return ~against & witnessed(pictures, shown, [views[k] for k in left])


def silhouette(
    hull: Bool[np.ndarray, " voxels"], sight: Sight, shape: tuple[int, int]
) -> Bool[np.ndarray, "height width"]:
    """Return the pixels in which a photograph would show a hull before the head."""
    drawn = np.zeros(shape[0] * shape[1], bool)
    drawn[sight.cell[hull & (sight.hair | sight.against)]] = True
    size = 2 * sight.reach + 1
    return np.asarray(ndimage.maximum_filter(drawn.reshape(shape), size=size))


def unexplained(hull: Bool[np.ndarray, " voxels"], sight: Sight, view: View) -> float:
    """Return the share of a photograph's hair that a hull leaves unexplained."""
    left = view.hair & ~silhouette(hull, sight, view.hair.shape)
    return float(left.sum() / max(view.hair.sum(), 1))


def disagreement_without(
    sights: Sequence[Sight], views: Sequence[View]
) -> Float[np.ndarray, " views"]:
    """Return how far the masks disagree when one photograph is left out.

    For each photograph: the mean over all others of the share of hair that is not
    explained by the hull of the remaining ones. The wrong photograph's is small.
    """
    count = len(views)
    share = np.zeros((count, count))
    for one in range(count):
        for other in range(one + 1, count):
            hull = hull_without(sights, views, (one, other))
            share[one, other] = unexplained(hull, sights[other], views[other])
            share[other, one] = unexplained(hull, sights[one], views[one])
    return share.sum(axis=1) / max(count - 1, 1)
