"""Where strands end: not beyond the outline that the photographs show.

The clusters of a tree are long as their strands are in the mean, so that the tips of
some stand out of the hull. A map of lengths on the scalp takes these back to where they
leave it, for every strand that may grow there.
"""

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ..host import on_device
from ..model.maps import ScalpMaps
from ..model.strand import Hair
from .density import texel_means
from .hull import Hull

# The border of the hull is that of pixels and voxels that hair touches: hair ends so
# many voxels deeper, but no deeper than this share of how deep its strand comes.
MARGIN = 0.25
DEEPEST = 0.5
SHORTEST = 0.05  # share of its length that a strand keeps
SMOOTH = 0.5  # texels
# Neighbours share a length by their mean of this power: single strands that stand out
# are seen, such that are too short are not.
POWER = -2.0


def with_tips_inside(maps: ScalpMaps, hair: Hair, hull: Hull) -> ScalpMaps:
    """Return maps with lengths at which strands end where they leave the hull.

    Args:
        maps: What is on the scalp, with the length 1 everywhere, `TEXELS` a side.
        hair: Strands of these maps, even over the scalp; none leave the maps.
        hull: Where hair can be.
    """
    if not len(hair.uv):
        return maps
    share = share_inside(np.asarray(hair.strands, np.float64), hull)
    uv = np.asarray(hair.uv, np.float64)
    count, mean = texel_means(uv, share**POWER, SMOOTH)
    mean = np.where(count > 0.0, mean, 1.0)
    length = on_device(mean ** (1.0 / POWER), maps.length.dtype)
    return eqx.tree_at(lambda m: m.length, maps, length)


def share_inside(
    strands: Float[np.ndarray, "strands points 3"], hull: Hull
) -> Float[np.ndarray, " strands"]:
    """Return the share of each strand that ends where it leaves the hull for good.

    Strands that are never in the hull are kept whole: it says nothing of them.

    Args:
        strands: Points at even distances along each strand, root first, in metres.
        hull: Where hair can be.
    """
    count, points = strands.shape[:2]
    depth = -hull.distance_at(strands.reshape(-1, 3)).reshape(count, points)
    told = depth.max(axis=1) > 0.0
    depth = depth[told]
    margin = np.minimum(MARGIN * hull.grid.spacing, DEEPEST * depth.max(axis=1))
    within = depth - margin[:, None]
    last = points - 1 - np.argmax(within[:, ::-1] >= 0.0, axis=1)
    row, after = np.arange(len(depth)), np.minimum(last + 1, points - 1)
    near, far = within[row, last], -within[row, after]
    # Beyond the grid is infinitely far: there the last point inside counts.
    step = np.where(last < points - 1, near / np.maximum(near + far, 1e-12), 0.0)
    share = np.ones(count)
    share[told] = np.clip((last + step) / (points - 1), SHORTEST, 1.0)
    return share
