"""Where hair that lies on the skin is shorn to some millimetres.

Shorn hair and long hair that is combed flat fill the same thin hull, and photographs
show the same directions in both: strands would run on through it. But streaks of shorn
hair end after as many millimetres as it is long, see `capture.streaks`. All photographs
that see a place are asked together, and as single places may be mistaken, it is said of
what has hardly other places around it, if that is much in all.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..capture.capture import View
from ..capture.orientation import OrientationMap
from ..capture.streaks import find_streaks
from ..render.raster import unit
from .grid import blurred
from .hull import Hull
from .stubble import enough

AROUND = 0.010  # metres, the standard deviation of a place
# Streaks whose far places are less alike than this share of their near ones end between
# the two. Of shorn hair (8 to 20 mm) 80 to 100 % of places have less, of longer hair
# that lies as thin 59 % at most. Around a place, by a Gaussian of so many metres, most
# have less on 72 cm³ of hair and more of heads that are shorn, on 16 cm³ of others.
ENDS, MOST, WIDER = 0.2, 0.7, 0.020
FOLLOWED = 0.075  # share of the streaks that must be followed where a place is told of
LEAST_NEAR = 0.05  # how alike near places are at least: noise is not
# And half of the places: most heads have 0.12 to 0.44, where noise of 6 % of white
# leads streaks astray 0.03 to 0.09.
SHARP = 0.1
LENGTH = 0.015  # metres, of shorn hair that lies
KINDS = 3  # of sums: see `streaks_at`


def streaks_at(
    points: Float[np.ndarray, "voxels 3"],
    outwards: Float[np.ndarray, "voxels 3"],
    view: View,
    found: OrientationMap,
    pixel: float,
    seen: Float[np.ndarray, " voxels"],
    at: tuple[Int[np.ndarray, " voxels"], Int[np.ndarray, " voxels"]],
) -> Float[np.ndarray, "voxels 3"]:
    """Return what one photograph tells of the streaks in every voxel of hair.

    Args:
        points: Centres of the voxels, in metres.
        outwards: Unit normals of the skin below them.
        view: The photograph.
        found: Its orientation map.
        pixel: Width of a pixel at the hair, in metres.
        seen: How well it sees each voxel, from 0 to 1.
        at: Row and column of the pixel in which each lands.

    Returns:
        How alike near and far places are, and how many of them, by how well the
        photograph sees the skin there from in front.
    """
    streaks = find_streaks(view.image, view.hair, found.angle, pixel)
    if streaks is None:
        return np.zeros((len(seen), KINDS))
    y, x = at
    rows, columns = streaks.count.shape
    place = y * rows // view.camera.height, x * columns // view.camera.width
    eye = np.asarray(view.camera.centre, np.float64)
    facing = (unit(eye - points) * outwards).sum(axis=1)
    share = seen * np.maximum(facing, 0.0) ** 2
    return share[:, None] * np.stack([one[place] for one in streaks], axis=1)


class Ends(NamedTuple):
    """Which voxels of hair are told of, and in which of all streaks end."""

    told: Bool[np.ndarray, " voxels"]
    ends: Bool[np.ndarray, " voxels"]

    def mostly(self, voxels: Bool[np.ndarray, " voxels"]) -> bool:
        """Return whether streaks end in most of these, as far as they are told of."""
        told = self.told & voxels
        return bool((self.ends & told).sum() >= MOST * told.sum())


def streak_ends(
    hull: Hull,
    thin: Bool[np.ndarray, " voxels"],
    sums: Float[np.ndarray, "voxels 3"],
) -> Ends:
    """Return where streaks end, as all photographs tell around a place.

    Args:
        hull: The hull.
        thin: Which voxels of hair have none near them but that close to the skin.
        sums: Of `streaks_at`, over all photographs.
    """
    sigma = AROUND / hull.grid.spacing
    near, far, count = (
        blurred(hull.hair, np.where(thin, one, 0.0), sigma)[hull.hair] for one in sums.T
    )
    followed = thin & (count > FOLLOWED)
    if (near > SHARP * count)[followed].sum() <= 0.5 * followed.sum():
        nowhere = np.zeros(len(thin), bool)
        return Ends(nowhere, nowhere)
    sharp = thin & (near > LEAST_NEAR * count)
    return Ends(sharp & followed, sharp & (far < ENDS * near))


def find_shorn(hull: Hull, streaks: Ends) -> Bool[np.ndarray, " voxels"]:
    """Return which voxels hold shorn hair, see `streak_ends`."""
    sigma = WIDER / hull.grid.spacing
    ends, told = (
        blurred(hull.hair, one.astype(float), sigma)[hull.hair]
        for one in (streaks.ends & streaks.told, streaks.told)
    )
    shorn = (told > 0.0) & (ends >= MOST * told)
    return streaks.ends & shorn & enough(hull, shorn & streaks.told)
