"""The hull's corners and ghosts, where silhouettes happen to meet: there is no hair.

The cones of a few views enclose more than the hair: edges where two of them cross, and
slabs and spikes behind or beside it. No mask excludes them, but none needs them either.
They are taken away from outside, most exposed voxels first, as long as every photograph
keeps hair behind each of its pixels of hair: towards the least surface that explains
the silhouettes (Kolev and Cremers 2008, by sweeps in place of a relaxation).

A bun or a tail is such a corner as well, where two or three views are all that see it.
But there the outlines themselves stick out, in both views at one place: that is hair.

Then hair of no level is higher above the skin than rays there need it to be: what
outlines show of a head on one side tells how thick its hair is all around.
"""

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..render.raster import cells, project_points
from .hull import Hull, hull_of, rooted_pieces
from .sightings import sight_lines

AROUND = 0.012  # metres: how far a voxel looks for others
EXPOSED = 0.47  # share of hair and head around a voxel below which it sticks out
KEPT = 0.024  # metres of hair that every ray through hair keeps
SWEEPS = 60
FEWEST_CUT = 3e-4  # of the hull; a sweep that cuts less is the last
FRONT = 0.002  # metres behind the head's surface up to which a view sees hair
LEVEL = 0.03  # metres up or down, within which hair is as high
MOST_RAYS = 0.99  # of a level's rays meet hair up to how high it is
LEAST_RAYS = 20  # of one view that tell it
LOWEST = 0.006  # metres of each ray's lowest hair that stay
DISC = 0.065  # metres: the radius of discs that fill an outline but for tails and buns
ROUGHLY = 0.002  # metres: pixels as wide show what sticks out
STICKS_OUT = 0.03  # metres that these come farther than the discs, at least
AT_ALL = 0.002  # metres; nearer is the outline's own roughness
# Cosine between two rays beyond which they do not cross: those of a tail that is seen
# from both sides pass all of the hair between.
ALIGNED = 0.75


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
    rays, out = zip(*abreast(partial(look, hull), views, depths), strict=True)
    hair = hull.hair.copy()
    left = np.ones(len(index), bool)
    least = round(KEPT / hull.grid.spacing)
    free = ~crossed(hull, views, out)
    for _ in range(SWEEPS):
        solid = hair | head
        around = ndimage.gaussian_filter(
            solid.astype(np.float32), AROUND / hull.grid.spacing, truncate=2.5
        )[tuple(index.T)]
        inner = np.asarray(ndimage.binary_erosion(solid), bool)[tuple(index.T)]
        around = np.where(free, around, 1.0)
        cut = left & ~inner & (around < EXPOSED)
        needed = partial(_kept, around=around, left=left, least=least)
        for kept in abreast(needed, rays):
            cut &= ~kept
        if cut.sum() < FEWEST_CUT * len(index):
            break
        left &= ~cut
        hair[tuple(index[cut].T)] = False
    cut = left & free & _too_high(hull, left, rays)
    left &= ~cut
    hair[tuple(index[cut].T)] = False
    if left.all() or not left.any():
        return hull
    return hull_of(hull.grid, rooted_pieces(hair, hull.head), hull.head)


def _too_high(
    hull: Hull,
    left: Bool[np.ndarray, " voxels"],
    rays: Sequence[Int[np.ndarray, " voxels"]],
) -> Bool[np.ndarray, " voxels"]:
    """Return the voxels higher above the skin than any view needs hair at their level.

    Args:
        hull: The hull.
        left: Which of its voxels are left.
        rays: The bundle of rays in which each view sees each of them.
    """
    height, level = hull.head[hull.hair], hull.grid.centres(hull.hair)[:, 1]
    levels = np.arange(level.min(), level.max() + LEVEL, 0.5 * LEVEL)
    top = np.zeros(len(levels))
    high = left.copy()
    for ray in rays:
        there = np.flatnonzero(left & (ray >= 0))
        order = there[np.lexsort((height[there], ray[there]))]
        seen, first = np.unique(ray[order], return_index=True)
        lowest = order[first]
        at = np.searchsorted(seen, ray[there])
        high[there] &= height[there] > height[lowest][at] + LOWEST
        for k, here in enumerate(levels):
            near = np.abs(level[lowest] - here) < LEVEL
            if near.sum() >= LEAST_RAYS:
                needed = np.quantile(height[lowest][near], MOST_RAYS)
                top[k] = max(top[k], float(needed))
    # Where nobody tells, hair may be as high as it likes.
    top[top == 0.0] = np.inf
    lower = np.clip(((level - levels[0]) / (0.5 * LEVEL)).astype(int), 0, len(top) - 2)
    return high & (height > np.maximum(top[lower], top[lower + 1]))


def crossed(
    hull: Hull, views: Sequence[View], out: Sequence[Bool[np.ndarray, " voxels"]]
) -> Bool[np.ndarray, " voxels"]:
    """Return the voxels at which what sticks out of two views' outlines meets.

    Args:
        hull: The hull that the masks allow.
        views: The photographs.
        out: The voxels that each sees in what sticks out, see `look`.
    """
    found = np.sum(out, axis=0) >= 2
    points = hull.grid.centres(hull.hair)[found]
    sums = np.zeros((len(points), 3, 3))
    for view, seen in zip(views, out, strict=True):
        along = sight_lines(points, view) * seen[found, None]
        sums += along[:, :, None] * along[:, None, :]
    found[found] = np.linalg.eigvalsh(sums)[:, 1] > 1.0 - ALIGNED
    return found


def sticking_out(
    view: View, depth: Float[np.ndarray, "height width"], pixel: float
) -> Bool[np.ndarray, "height width"]:
    """Return where hair sticks out of the outline of hair and head.

    Discs as wide as half a head fill an outline but for buns, tails and loose locks.

    Args:
        view: The photograph with its mask.
        depth: Depth of the head in it in metres, infinite beside the head.
        pixel: Width of a pixel at the hair, in metres.
    """
    import cv2

    step = max(1, int(ROUGHLY / pixel))
    hair = view.hair[::step, ::step]
    disc = DISC / (step * pixel)
    # What a border of the picture cuts off goes on beyond it.
    margin = int(disc) + 2
    solid = hair | (np.isfinite(depth) & (depth > 0))[::step, ::step]
    solid = np.pad(solid, margin, mode="edge")
    core = np.asarray(cv2.distanceTransform(solid.astype(np.uint8), cv2.DIST_L2, 5))
    if core.max() <= disc:
        return np.zeros_like(view.hair)
    beside = (core <= disc).astype(np.uint8)
    far = np.asarray(cv2.distanceTransform(beside, cv2.DIST_L2, 5)) - disc
    far = step * pixel * np.where(solid, far, 0.0)[margin:-margin, margin:-margin]
    pieces = np.zeros(far.shape, np.int32)
    ndimage.label(far > AT_ALL, output=pieces)
    top = np.zeros(pieces.max() + 1)
    np.maximum.at(top, pieces, far)
    found = (pieces > 0) & (top > STICKS_OUT)[pieces]
    height, width = view.hair.shape
    wide = found.repeat(step, axis=0)[:height].repeat(step, axis=1)[:, :width]
    return view.hair & wide


class Look(NamedTuple):
    """What a view sees of the hull's voxels.

    Attributes:
        ray: The bundle of rays, a voxel wide, in which it sees each of them; -1 for
            those that it does not see: behind the head or out of the picture.
        out: Which it sees in hair that sticks out of the outline.
    """

    ray: Int[np.ndarray, " voxels"]
    out: Bool[np.ndarray, " voxels"]


def look(hull: Hull, view: View, depth: Float[np.ndarray, "height width"]) -> Look:
    """Return what a view sees of the hull's voxels.

    Args:
        hull: The hull that the masks allow.
        view: The photograph.
        depth: Depth of the head in it, in metres.
    """
    pixels = project_points(hull.grid.centres(hull.hair), view.camera)
    y, x, seen = cells(pixels, view.camera.width, view.camera.height)
    seen &= view.hair[y, x] & (pixels.depth < depth[y, x] + FRONT)
    pixel = max(float(np.median(pixels.depth)), 0.05) / view.camera.focal
    wide = max(1, round(hull.grid.spacing / pixel))
    ray = np.where(seen, (y // wide) * view.camera.width + x // wide, -1)
    return Look(ray, seen & sticking_out(view, depth, pixel)[y, x])


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
