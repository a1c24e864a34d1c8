"""Hair of a few millimetres that stands out of the skin.

Each hair is a few pixels long, before skin and others, so that maps are hardly sure of
it; what they are sure of beside it, or that hair lies in the surface, would decide. But
all hairs of a place together tell which way they stand: the planes that hold them hold
the skin's normal as well. Those of hair that lies on the skin hold it only where it
runs as the cameras stand, a ring of them about a head whose hair is combed to the back.
But they hold a line on the skin much better, and show it clearly.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from .grid import blurred, uphill
from .hull import Hull

SHORT = 0.014  # metres above the skin up to which all hair reaches
AROUND = 0.009  # metres from higher hair, and the standard deviation of a place
# Hair stands where planes miss the skin's normal by less: the mean square of the sine.
# Shaved heads have 0.01 to 0.11, thin hair that lies on the skin 0.39 to 0.48.
STANDING = 0.2
LYING = 1.5  # times as much as the best line on the skin is missed
# Planes that are one hold a line on the skin in any case; stubble then is what maps are
# hardly sure of: 0.02 to 0.2 on shaved heads, 0.6 to 1 on hair combed to the back.
ONE_PLANE = 0.05  # share of the planes' second eigenvalue
FAINT = 0.2  # confidence
LOOKED_AT = 0.5  # views at least that see such a place, in the mean around it
# Few photographs look at less: so large a share of them at least, where as much hair as
# on a shaved head stands, in cubic metres; single places may be mistaken.
LEAST_SHARE, SHAVED = 1.0 / 16.0, 3e-5
UPRIGHT = 0.05  # of "hair stands upright", against the views: they may agree on a plane


class Stubble(NamedTuple):
    """Which voxels of hair hold stubble, and the unit direction without sign of each.

    Attributes:
        stands: One for each voxel of hair.
        direction: One for each voxel of stubble.
    """

    stands: Bool[np.ndarray, " voxels"]
    direction: Float[np.ndarray, "standing 3"]


def enough(hull: Hull, voxels: Bool[np.ndarray, " _"]) -> bool:
    """Return whether so much hair is more than a few places that may be mistaken."""
    return float(voxels.sum()) * hull.grid.spacing**3 >= SHAVED


def thin_hair(hull: Hull) -> Bool[np.ndarray, " voxels"]:
    """Return which voxels of hair have none near them but that close to the skin."""
    spacing, height = hull.grid.spacing, hull.head[hull.hair]
    high = hull.hair & (hull.head > SHORT)
    away = np.full(len(height), np.inf)
    if high.any():
        away = spacing * np.asarray(ndimage.distance_transform_edt(~high))[hull.hair]
    # What is at the skin may have high hair right above it.
    return away > np.maximum(AROUND, SHORT - height + spacing)


def find_stubble(
    hull: Hull,
    thin: Bool[np.ndarray, " voxels"],
    planes: Float[np.ndarray, "voxels 3 3"],
    total: Float[np.ndarray, " voxels"],
    looks: Float[np.ndarray, " voxels"],
    count: int,
) -> Stubble:
    r"""Return where stubble stands, and which way.

    Args:
        hull: The hull.
        thin: Which voxels of hair `thin_hair` finds.
        planes: $\sum w\,n n^T$ of the views' planes in every voxel of hair.
        total: $\sum w$.
        looks: How many views see each voxel.
        count: How many views there are.
    """
    sigma = AROUND / hull.grid.spacing

    def around(values):
        return blurred(hull.hair, np.where(thin, values, 0.0), sigma)[hull.hair]

    normal = uphill(hull.head)[hull.hair]
    missed = np.einsum("vi,vij,vj->v", normal, planes, normal)
    stands = thin & (around(missed) < STANDING * around(total))
    looked, places = around(looks), around(1.0)
    stands &= looked > min(LOOKED_AT, LEAST_SHARE * count) * places
    if not stands.any():
        return Stubble(stands, np.zeros((0, 3)))
    mean = np.zeros((int(stands.sum()), 3, 3))
    for row, column in zip(*np.triu_indices(3), strict=True):
        entry = around(planes[:, row, column])[stands]
        mean[:, row, column] = mean[:, column, row] = entry
    upright = normal[stands][:, :, None] * normal[stands][:, None, :]
    aside = np.eye(3) - upright
    size = np.trace(mean, axis1=1, axis2=2)[:, None, None]
    # The least eigenvalue on the skin: the one along the normal is made the largest.
    lying = np.linalg.eigvalsh(aside @ mean @ aside + size * upright)[:, 0]
    told = (mean * upright).sum(axis=(1, 2)) < LYING * lying
    size = size[:, 0, 0]
    faint = size < FAINT * looked[stands]
    told |= faint & (np.linalg.eigvalsh(mean)[:, 1] < ONE_PLANE * size)
    if not enough(hull, told):
        told &= (looked > LOOKED_AT * places)[stands]
    stands[stands] = told
    tilted = mean[told] + UPRIGHT * size[told, None, None] * aside[told]
    return Stubble(stands, np.linalg.eigh(tilted)[1][:, :, 0])
