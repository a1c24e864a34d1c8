"""Strands of a tree that stay out of the head."""

import jax
import numpy as np
from jaxtyping import Float, Int

from ..capture.distance import push_out, signed_distance
from ..errors import InputError
from ..model.strand import sample_strands
from ..model.tree import HairTree
from ..types import Mesh, Strands
from .grow import resample_paths

# A strand that leaves the tree inside the skin is laid this far above it. Metres.
SKIN_GAP = 0.0005
# What still runs deeper than this is cut off: thin parts of a mesh, sharp corners.
DEEPEST = 0.0007
HIGHEST_ROOT = 0.0018  # metres above the skin
PIECES = 24  # a segment near the skin is looked at in so many pieces
SPARE = 1.03  # for strands that must go as a whole


def derive_strands(
    tree: HairTree, head: Mesh | None, count: int, points: int, seed: int
) -> Strands:
    """Return strands of a tree, laid onto the skin where they would run under it.

    Where a strand dives into the head all the same, it ends.

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
    strands = push_out(head, strands.reshape(-1, 3), SKIN_GAP).reshape(strands.shape)
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


def last_outside(
    strands: Float[np.ndarray, "strands points 3"], head: Mesh
) -> Int[np.ndarray, " strands"]:
    """Return the last point of each strand before it first dives into the head."""
    count, points = strands.shape[:2]
    if not count:
        return np.zeros(0, int)
    skin = signed_distance(head, strands.reshape(-1, 3)).reshape(count, points)
    start, step = strands[:, :-1], np.diff(strands, axis=1)
    length = np.linalg.norm(step, axis=2)
    # The middle of a longer segment than its ends are far may be inside.
    near = np.minimum(skin[:, 1:], skin[:, :-1]) < 0.5 * length
    strand, segment = np.nonzero(near)
    share = np.arange(1, PIECES) / PIECES
    between = start[near][:, None] + share[None, :, None] * step[near][:, None]
    depth = signed_distance(head, between.reshape(-1, 3)).reshape(-1, PIECES - 1)
    dives = skin[:, 1:] < -DEEPEST
    dives[strand, segment] |= depth.min(axis=1) < -DEEPEST
    # The patch is smooth and leaves out the mesh's pits: no hair grows over these.
    rooted = (skin[:, 0] >= -DEEPEST) & (skin[:, 0] <= HIGHEST_ROOT)
    first = np.where(dives.any(axis=1), dives.argmax(axis=1), points - 1)
    return np.where(rooted, first, 0)
