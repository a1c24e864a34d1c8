"""Strands of a tree that stay out of the head."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from ..capture.distance import push_out, signed_distance
from ..errors import InputError
from ..model.strand import sample_strands
from ..model.tree import HairTree
from ..types import Mesh, Strands, resample_paths

# A strand that leaves the tree inside the skin is laid this far above it. Metres.
SKIN_GAP = 0.0005
# What still runs deeper than this is cut off: thin parts of a mesh, sharp corners.
DEEPEST = 0.0007
HIGHEST_ROOT = 0.0018  # metres above the skin
PIECES = 24  # a segment near the skin is looked at in so many pieces
SPARE = 1.03  # for strands that must go as a whole
LIFTS = 6  # how often strands are lifted over corners that they would cut
FARTHEST_LIFT = 0.004  # metres that a point is lifted each time, at most


def derive_strands(
    tree: HairTree, head: Mesh | None, count: int, points: int, seed: int
) -> Strands:
    """Return strands of a tree, laid onto the skin where they would run under it.

    Segments that would cut through a bulge of the skin are lifted over it. Where a
    strand dives into the head all the same, it ends.

    Args:
        tree: The tree.
        head: The head; None leaves the strands as they are.
        count: Number of strands.
        points: Number of points of each strand.
        seed: Of the roots.

    Raises:
        InputError: If the tree's clusters cover nothing of the scalp.
    """
    wanted = count if head is None else int(SPARE * count) + 1
    found = np.array(sample_strands(tree, wanted, points, jax.random.key(seed)))
    if not len(found):
        raise InputError(
            "no strand grows from the tree: its clusters cover nothing of the scalp; "
            "fit it again."
        )
    if head is not None:
        found = _outside(found.astype(np.float64), head)[:count]
    return Strands.from_array(found)


def _outside(
    strands: Float[np.ndarray, "strands points 3"], head: Mesh
) -> Float[np.ndarray, "kept points 3"]:
    """Return the strands laid onto the skin, cut where they dive, without stubs."""
    points = strands.shape[1]
    strands = lifted(strands, head)
    # As they will be stored: rounding may not push a point back in.
    strands = strands.astype(np.float32).astype(np.float64)
    last = last_outside(strands, head)
    cut = np.flatnonzero(last < points - 1)
    for strand in cut:
        strands[strand, last[strand] :] = strands[strand, last[strand]]
    strands[cut] = resample_paths(strands[cut], points)
    keep = last > 0
    keep[cut] &= last_outside(strands[cut], head) == points - 1
    return strands[keep]


def lifted(
    strands: Float[np.ndarray, "strands points 3"], head: Mesh
) -> Float[np.ndarray, "strands points 3"]:
    """Return strands whose points, and whose segments if some steps can do it, are out.

    Both ends of a segment that runs under the skin move out by as much as its deepest
    spot has to; roots stay.

    Args:
        strands: The strands, in metres.
        head: The head.
    """
    strands = laid(strands, head)
    left = np.arange(len(strands))
    for _ in range(LIFTS):
        dives = find_dives(strands[left], head)
        if not len(dives.strand):
            break
        out = push_out(head, dives.spot, SKIN_GAP) - dives.spot
        far = np.linalg.norm(out, axis=1, keepdims=True)
        out *= np.minimum(1.0, FARTHEST_LIFT / np.maximum(far, 1e-9))
        owner = left[dives.strand]
        for end in (dives.segment, dives.segment + 1):
            moves = end > 0
            strands[owner[moves], end[moves]] += out[moves]
        left = np.unique(owner)
        strands[left, 1:] = laid(strands[left, 1:], head)
    return strands


def laid(
    strands: Float[np.ndarray, "strands points 3"], head: Mesh
) -> Float[np.ndarray, "strands points 3"]:
    """Return strands with those points that are in the head laid onto its skin."""
    return push_out(head, strands.reshape(-1, 3), SKIN_GAP).reshape(strands.shape)


class Dives(NamedTuple):
    """Segments of strands that run under the skin, and the deepest spot of each."""

    strand: Int[np.ndarray, " dives"]
    segment: Int[np.ndarray, " dives"]
    spot: Float[np.ndarray, "dives 3"]


def find_dives(strands: Float[np.ndarray, "strands points 3"], head: Mesh) -> Dives:
    """Return the segments that run deeper in the head than is let pass."""
    count, points = strands.shape[:2]
    skin = signed_distance(head, strands.reshape(-1, 3)).reshape(count, points)
    start, step = strands[:, :-1], np.diff(strands, axis=1)
    length = np.linalg.norm(step, axis=2)
    # Distance changes by no more than one walks: the others cannot get there.
    near = skin[:, 1:] + skin[:, :-1] < length - 2.0 * DEEPEST
    strand, segment = np.nonzero(near)
    share = np.arange(1, PIECES + 1) / PIECES
    spots = start[near][:, None] + share[None, :, None] * step[near][:, None]
    depth = signed_distance(head, spots.reshape(-1, 3)).reshape(-1, PIECES)
    deepest = depth.argmin(axis=1)
    row = np.flatnonzero(depth.min(axis=1) < -DEEPEST)
    return Dives(strand[row], segment[row], spots[row, deepest[row]])


def last_outside(
    strands: Float[np.ndarray, "strands points 3"], head: Mesh
) -> Int[np.ndarray, " strands"]:
    """Return the last point of each strand before it first dives into the head."""
    count, points = strands.shape[:2]
    if not count:
        return np.zeros(0, int)
    dives = find_dives(strands, head)
    first = np.full(count, points - 1)
    np.minimum.at(first, dives.strand, dives.segment)
    # The patch is smooth and leaves out the mesh's pits: no hair grows over these.
    height = signed_distance(head, strands[:, 0])
    return np.where((height >= -DEEPEST) & (height <= HIGHEST_ROOT), first, 0)
