"""Strands for what grown ones left empty: they branch off where hair comes from.

Strands that run side by side stay side by side. What passes a tie comes out of it as
thin as it went in, and of the tail behind it most stays empty, though the flow fills
it. So from empty places one goes up the flow until a strand is met that runs the same
way, and down to the tip: a strand that shares the root of the one it was met by.

Above a parting the outermost hair of either side begins in the air, as lines part
there: it rises from the roots below and goes over. So a path that meets no strand, and
ends above roots, begins at the nearest of them.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage
from scipy.spatial import KDTree

from ..render.raster import unit
from ..types import resample_paths
from .grow import AT_ONCE, GrowConfig, Space, grow
from .hull import Hull

DEEP = 1.0  # voxels within the hull: what lies nearer to its border may be no hair
EMPTY = 1.5  # voxels from any strand from which on a place is empty
MEET = 1.5  # voxels at which a path meets a strand
EASE = 3.0  # gaps between the two, over which a branch leaves its strand
SAME = 0.7  # cosine of the angle between the two
CLOSEST = 24  # points of strands that a path looks at
ROUNDS = 2
SEEDS = 0.125  # empty places tried in a round, for each strand; in whole batches
FINE = 150  # points of a path
SMOOTH = 4.0  # points over which a branch leaves its strand
# A path that ends in the air begins at a root that is no farther than this, in metres,
# and no farther than so many times the height above the skin, and a voxel.
RISE, UPRIGHT = 0.03, 1.3


class Branched(NamedTuple):
    """Strands, and by number the grown one whose root each has."""

    strands: Float[np.ndarray, "strands knots 3"]
    origin: Int[np.ndarray, " strands"]


def with_branches(
    hull: Hull,
    space: Space,
    strands: Float[np.ndarray, "strands knots 3"],
    config: GrowConfig,
    seed: int,
) -> Branched:
    """Return grown strands, and after them others through what they left empty.

    Args:
        hull: Where hair can be.
        space: How it runs there.
        strands: The grown strands, root first, in metres.
        config: How they were grown.
        seed: Of the places that are tried.
    """
    rng = np.random.default_rng(seed)
    found, origin = strands, np.arange(len(strands))
    # What is traced together costs as much with fewer.
    roots = KDTree(strands[:, 0])
    back = space.backwards()
    count = AT_ONCE * int(np.ceil(SEEDS * len(strands) / AT_ONCE))
    for _ in range(ROUNDS):
        paths = resample_paths(found, FINE)
        near = KDTree(paths.reshape(-1, 3))
        empty = empty_places(hull, near)
        if not len(empty):
            break
        start = empty[rng.choice(len(empty), count, replace=len(empty) < count)]
        start = start + rng.uniform(-0.5, 0.5, start.shape) * hull.grid.spacing
        still = np.zeros_like(start)
        down = grow(space, start, still, FINE, config)
        up = grow(back, start, still, FINE, config)
        met = meetings(paths, near, up, MEET * hull.grid.spacing)
        met = rooted_below(hull, roots, up, met)
        some = np.flatnonzero(met.strand >= 0)
        if not len(some):
            break
        branches = resample_paths(joined(paths, up, down, met, some), strands.shape[1])
        found = np.concatenate([found, branches])
        origin = np.concatenate([origin, origin[met.strand[some]]])
    return Branched(found, origin)


def empty_places(hull: Hull, near: KDTree) -> Float[np.ndarray, "places 3"]:
    """Return the middles of voxels within the hull that no strand comes near.

    Args:
        hull: Where hair can be.
        near: Points of the strands, closer to each other than voxels.
    """
    spacing = hull.grid.spacing
    middles = hull.grid.centres(hull.hair & (hull.distance <= -DEEP * spacing))
    away = near.query(middles, distance_upper_bound=EMPTY * spacing, workers=-1)[0]
    return middles[~np.isfinite(away)]


class Meetings(NamedTuple):
    """Where paths up the flow first meet a strand that runs the same way.

    Attributes:
        strand: The strand; -1 for paths that meet none.
        at: The point of the strand at which a branch leaves it.
        step: The point of the path.
    """

    strand: Int[np.ndarray, " paths"]
    at: Int[np.ndarray, " paths"]
    step: Int[np.ndarray, " paths"]


def meetings(
    strands: Float[np.ndarray, "strands points 3"],
    near: KDTree,
    up: Float[np.ndarray, "paths steps 3"],
    reach: float,
) -> Meetings:
    """Return where paths that run towards roots meet strands.

    Args:
        strands: The strands, root first, in metres.
        near: Their points, strand by strand.
        up: The paths.
        reach: How close is met, in metres.
    """
    points = strands.shape[1]
    away, index = near.query(up, k=CLOSEST, distance_upper_bound=reach, workers=-1)
    index = np.where(np.isfinite(away), index, 0)
    ahead = unit(np.gradient(strands, axis=1)).reshape(-1, 3)[index]
    cosine = np.einsum("psx,pskx->psk", -unit(np.gradient(up, axis=1)), ahead)
    away = np.where(cosine > SAME, away, np.inf)
    best = away.argmin(axis=2)
    step = np.isfinite(away.min(axis=2)).argmax(axis=1)
    row = np.arange(len(up))
    chosen = row, step, best[row, step]
    strand, at = np.divmod(index[chosen], points)
    gap = away[chosen]
    meets = np.isfinite(gap)
    # Left where the way over to the path begins, not where the two are closest.
    edge = np.linalg.norm(np.diff(strands[strand], axis=1), axis=2).mean(axis=1)
    back = np.rint(EASE * np.where(meets, gap, 0.0) / np.maximum(edge, 1e-9))
    return Meetings(
        np.where(meets, strand, -1), np.maximum(at - back.astype(int), 0), step
    )


def rooted_below(
    hull: Hull,
    roots: KDTree,
    up: Float[np.ndarray, "paths steps 3"],
    met: Meetings,
) -> Meetings:
    """Return meetings where paths that met nothing, but end above roots, meet a root.

    Args:
        hull: Where hair can be, and how far from the skin.
        roots: Of the grown strands.
        up: Paths from empty places towards roots.
        met: Where they meet strands.
    """
    end, spacing = up[:, -1], hull.grid.spacing
    height = hull.head[hull.grid.locate(end).at]
    away, root = roots.query(end, distance_upper_bound=RISE, workers=-1)
    below = (met.strand < 0) & (away < UPRIGHT * height + spacing)
    return Meetings(
        np.where(below, root, met.strand),
        np.where(below, 0, met.at),
        np.where(below, up.shape[1] - 1, met.step),
    )


def joined(
    strands: Float[np.ndarray, "strands points 3"],
    up: Float[np.ndarray, "paths steps 3"],
    down: Float[np.ndarray, "paths steps 3"],
    met: Meetings,
    some: Int[np.ndarray, " branches"],
) -> Float[np.ndarray, "branches points 3"]:
    """Return smooth strands: along one that was met, the way up to it, the way down.

    Args:
        strands: The strands, root first, in metres.
        up: Paths from empty places towards roots.
        down: Paths from the same places towards tips.
        met: Where the paths up meet strands.
        some: The paths that meet one.
    """
    lines = []
    for path in some:
        strand, at, step = met.strand[path], met.at[path], met.step[path]
        parts = strands[strand, : at + 1], up[path, step::-1], down[path, 1:]
        lines.append(resample_paths(np.concatenate(parts)[None], strands.shape[1]))
    smooth = np.concatenate(lines)
    smooth = ndimage.gaussian_filter1d(smooth, SMOOTH, axis=1, mode="nearest")
    smooth[:, 0] = strands[met.strand[some], 0]
    return smooth
