"""Bridges to pieces of the hull that stand apart: a tail behind its tie.

What ties hair hides it from all sides, so that masks leave nothing between the head and
the tail, where strands have to pass. A piece that masks show, and that nothing else
explains, hangs on the rest at the narrowest gap, which a bridge fills.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from ..capture.capture import View
from .grid import Grid
from .hull import Hull, hull_of, rooted_pieces
from .unexplained import covered

SMALLEST = 1e-5  # cubic metres; smaller pieces are single locks
WIDEST = 0.04  # metres: no gap is wider
# Voxels are of the bridge whose way from end to end is longer than the shortest by no
# more than this, in metres: a tie is as wide as that makes it.
LONGER = 0.012
# In so many photographs a piece has to explain such a share of the hair alone.
SHOWN, ALONE = 2, 0.02
ROOTED = 2  # voxels from the next root, at most
EVERY_WAY = np.ones((3, 3, 3), bool)


def bridged(
    hull: Hull, roots: Float[np.ndarray, "roots 3"], views: Sequence[View]
) -> Hull:
    """Return the hull with bridges to the pieces that photographs show.

    Pieces that stay in the air go.

    Args:
        hull: The hull.
        roots: Where strands grow, in metres.
        views: The photographs.
    """
    pieces = pieces_of(hull.hair)
    sizes = np.bincount(pieces.ravel())[1:]
    rooted = np.isin(pieces, _at_roots(hull.grid, pieces, roots))
    if not rooted.any():
        return hull
    found = hull.hair.copy()
    for label in np.argsort(-sizes, kind="stable") + 1:
        if sizes[label - 1] * hull.grid.spacing**3 < SMALLEST:
            break
        piece = pieces == label
        if rooted[piece].any() or not shown_alone(hull.grid, piece, rooted, views):
            continue
        bridge = _bridge(rooted, piece, hull.head > 0.0, hull.grid.spacing)
        if bridge.any():
            rooted |= piece | bridge
            found |= bridge
    found = rooted_pieces(found, hull.head, airborne=np.inf)
    return hull_of(hull.grid, found, hull.head) if (found != hull.hair).any() else hull


def pieces_of(hair: Bool[np.ndarray, "x y z"]) -> Int[np.ndarray, "x y z"]:
    """Return the number of the piece that each voxel is of, from 1 on; 0 for none.

    Voxels that share a face, an edge or a corner are of one piece.
    """
    pieces = np.zeros(hair.shape, np.int32)
    ndimage.label(hair, EVERY_WAY, output=pieces)
    return pieces


def shown_alone(
    grid: Grid,
    piece: Bool[np.ndarray, "x y z"],
    rest: Bool[np.ndarray, "x y z"],
    views: Sequence[View],
) -> bool:
    """Return whether photographs show hair that only one piece explains.

    Args:
        grid: The voxels.
        piece: Those of the piece.
        rest: Those of other pieces.
        views: The photographs.
    """
    count = 0
    for view in views:
        alone = view.hair & covered(grid, piece, view) & ~covered(grid, rest, view)
        count += int(alone.sum() > ALONE * view.hair.sum())
    return count >= min(SHOWN, len(views))


def _at_roots(
    grid: Grid, pieces: Int[np.ndarray, "x y z"], roots: Float[np.ndarray, "roots 3"]
) -> Int[np.ndarray, " rooted"]:
    """Return the pieces that hold roots, or have one beside them."""
    voxel = grid.voxel(roots)
    near = np.zeros(grid.shape, bool)
    near[tuple(voxel[grid.inside(voxel)].T)] = True
    near = np.asarray(ndimage.binary_dilation(near, EVERY_WAY, iterations=ROOTED), bool)
    found = np.unique(pieces[near])
    return found[found > 0]


def _bridge(
    rooted: Bool[np.ndarray, "x y z"],
    piece: Bool[np.ndarray, "x y z"],
    free: Bool[np.ndarray, "x y z"],
    spacing: float,
) -> Bool[np.ndarray, "x y z"]:
    """Return the free voxels between two pieces, none across too wide a gap.

    Args:
        rooted: One of them.
        piece: The other.
        free: Where hair can pass.
        spacing: Edge of a voxel, in metres.
    """
    from_root = np.asarray(ndimage.distance_transform_edt(~rooted))
    free = free & ~rooted & ~piece
    if spacing * from_root[piece].min() > WIDEST or not free.any():
        return np.zeros_like(piece)
    way = from_root + np.asarray(ndimage.distance_transform_edt(~piece))
    return free & (way <= way[free].min() + LONGER / spacing)
