"""Hair in photographs that no place in space explains: something took too much.

Wherever a mask shows hair there is some along the ray. Gaps between sparse hairs, and
directions that noise leads astray, leave rays with none.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..render.raster import cells, project_points
from .grid import Grid

# Photographs in which nothing else explains a voxel, at least, and as a share of those
# that see it.
FEWEST, SHARE = 2, 0.5


def covered(
    grid: Grid, voxels: Bool[np.ndarray, "x y z"], view: View
) -> Bool[np.ndarray, "height width"]:
    """Return the pixels before voxels, and as many around as a voxel is wide."""
    struck = np.zeros(view.hair.shape, bool)
    if not voxels.any():
        return struck
    pixels = project_points(grid.centres(voxels), view.camera)
    y, x, seen = cells(pixels, view.camera.width, view.camera.height)
    struck[y[seen], x[seen]] = True
    middle = max(float(np.median(pixels.depth)), 0.05)
    wide = int(np.ceil(grid.spacing * view.camera.focal / middle))
    return np.asarray(ndimage.maximum_filter(struck, size=2 * wide + 1), bool)


def share_unexplained(
    grid: Grid,
    hair: Bool[np.ndarray, "x y z"],
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
) -> float:
    """Return the share of hair before the head that no voxel explains.

    The median over the views, so that one wrong mask does not decide.

    Args:
        grid: The voxels.
        hair: Which of them may hold hair.
        views: The photographs with their masks.
        depths: Depth of the head in each photograph, in metres; infinite beside it.
    """

    def one(view: View, depth: Float[np.ndarray, "height width"]) -> float:
        skin = view.hair & np.isfinite(depth) & (depth > 0.0)
        return float((skin & ~covered(grid, hair, view)).sum() / max(skin.sum(), 1))

    return float(np.median(list(abreast(one, views, depths))))


def with_unexplained(
    grid: Grid,
    hair: Bool[np.ndarray, "x y z"],
    gone: Bool[np.ndarray, "x y z"],
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
) -> Bool[np.ndarray, "x y z"]:
    """Return the voxels of hair, and of what is gone those that photographs need.

    Args:
        grid: The voxels.
        hair: Those that are left.
        gone: Those that something took.
        views: The photographs with their masks.
        depths: Depth of the head in each photograph, in metres.
    """
    points = grid.centres(gone)

    def one(view, depth):
        pixels = project_points(points, view.camera)
        y, x, inside = cells(pixels, view.camera.width, view.camera.height)
        seen = inside & view.hair[y, x] & (pixels.depth < depth[y, x])
        return seen, seen & ~covered(grid, hair, view)[y, x]

    told = np.array(list(abreast(one, views, depths)))
    seen, needed = told.sum(axis=0)
    out = hair.copy()
    out[gone] = needed >= np.maximum(FEWEST, SHARE * seen)
    return out
