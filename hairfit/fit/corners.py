"""The hull's corners and ghosts, where silhouettes happen to meet: there is no hair.

The cones of a few views enclose more than the hair: edges where two of them cross, and
slabs and spikes behind or beside it. No mask excludes them, but none needs them either.
They are taken away from outside, most exposed voxels first, as long as every photograph
keeps hair behind each of its pixels of hair: towards the least surface that explains
the silhouettes (Kolev and Cremers 2008, by sweeps in place of a relaxation).
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..render.raster import cells, project_points
from .hull import Hull, hull_of, rooted_pieces

AROUND = 0.012  # metres: how far a voxel looks for others
EXPOSED = 0.47  # share of hair and head around a voxel below which it sticks out
KEPT = 0.024  # metres of hair that every ray through hair keeps
SWEEPS = 60
FEWEST_CUT = 3e-4  # of the hull; a sweep that cuts less is the last
FRONT = 0.002  # metres behind the head's surface up to which a view sees hair


def carve_corners(
    hull: Hull,
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
) -> Hull:
    """Return the hull without what sticks out of it and explains no photograph.

    Args:
        hull: The hull that the masks allow.
        views: The photographs.
        depths: Depth of the head in each photograph, in metres.
    """
    index = np.argwhere(hull.hair)
    head = hull.head < 0
    rays = list(abreast(partial(_rays, hull), views, depths))
    hair = hull.hair.copy()
    left = np.ones(len(index), bool)
    least = round(KEPT / hull.grid.spacing)
    for _ in range(SWEEPS):
        solid = hair | head
        around = ndimage.gaussian_filter(
            solid.astype(np.float32), AROUND / hull.grid.spacing, truncate=2.5
        )[tuple(index.T)]
        inner = np.asarray(ndimage.binary_erosion(solid), bool)[tuple(index.T)]
        cut = left & ~inner & (around < EXPOSED)
        needed = partial(_kept, around=around, left=left, least=least)
        for kept in abreast(needed, rays):
            cut &= ~kept
        if cut.sum() < FEWEST_CUT * len(index):
            break
        left &= ~cut
        hair[tuple(index[cut].T)] = False
    if left.all() or not left.any():
        return hull
    return hull_of(hull.grid, rooted_pieces(hair, hull.head), hull.head)


def _rays(
    hull: Hull, view: View, depth: Float[np.ndarray, "height width"]
) -> Int[np.ndarray, " voxels"]:
    """Return the bundle of rays, a voxel wide, in which a view sees each voxel.

    -1 stands for voxels that it does not see: behind the head or out of the picture.
    """
    points = hull.grid.centres(hull.hair)
    pixels = project_points(points, view.camera)
    y, x, seen = cells(pixels, view.camera.width, view.camera.height)
    seen &= view.hair[y, x] & (pixels.depth < depth[y, x] + FRONT)
    middle = max(float(np.median(pixels.depth)), 0.05)
    wide = max(1, round(hull.grid.spacing * view.camera.focal / middle))
    return np.where(seen, (y // wide) * view.camera.width + x // wide, -1)


def _kept(
    ray: Int[np.ndarray, " voxels"],
    around: Float[np.ndarray, " voxels"],
    left: Bool[np.ndarray, " voxels"],
    least: int,
) -> Bool[np.ndarray, " voxels"]:
    """Return the voxels that a view needs: the least exposed ones of each ray."""
    there = np.flatnonzero(left & (ray >= 0))
    order = there[np.lexsort((-around[there], ray[there]))]
    first = np.ones(len(order), bool)
    first[1:] = ray[order][1:] != ray[order][:-1]
    start = np.maximum.accumulate(np.where(first, np.arange(len(order)), 0))
    kept = np.zeros(len(ray), bool)
    kept[order[np.arange(len(order)) - start < least]] = True
    return kept
