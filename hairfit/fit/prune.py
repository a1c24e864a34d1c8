"""Leaf clusters that run where no hair can be are taken out of the tree."""

import numpy as np
from jaxtyping import Float

from ..model.tree import HairTree, leaves, take
from .hull import Hull
from .samples import Samples, sampled_strands

STRAY = 0.006  # metres outside the hull at which a point counts as lost
MOST_LOST = 0.12  # share of lost points that a leaf may have
POINTS = 24


def prune(
    tree: HairTree,
    samples: Samples,
    hull: Hull,
    *,
    points: int = POINTS,
    room: int = 0,
) -> HairTree:
    """Return the tree without leaves whose strands leave the hull.

    Their roots go to the closest leaf below the same cluster, as figure 4-15 of the
    thesis has it; so each cluster keeps at least its best leaf.

    Args:
        tree: The tree.
        samples: Strands over the whole scalp.
        hull: Where hair can be.
        points: How many points of each strand are looked at.
        room: Arrays hold so many clusters, if the tree has fewer: `sampled_strands`.
    """
    lost = lost_share(tree, samples, hull, points=points, room=room)
    parent = np.asarray(tree.parent)
    leaf = np.zeros(tree.count, bool)
    leaf[leaves(tree)] = True
    keep = ~leaf | (lost <= MOST_LOST)
    for above in np.unique(parent[leaf]):
        below = np.flatnonzero(leaf & (parent == above))
        if above >= 0 and not keep[below].any():
            keep[below[np.argmin(lost[below])]] = True
    return take(tree, keep)


def lost_share(
    tree: HairTree,
    samples: Samples,
    hull: Hull,
    *,
    points: int = POINTS,
    room: int = 0,
) -> Float[np.ndarray, " clusters"]:
    """Return the share of each leaf's strands' points that are outside the hull."""
    places = sampled_strands(tree, samples, points, room).reshape(-1, 3)
    share = (hull.distance_at(places) > STRAY).reshape(-1, points).mean(axis=1)
    owner = np.asarray(samples.owner)
    total = np.bincount(owner, share, minlength=tree.count)
    return total / np.maximum(np.bincount(owner, minlength=tree.count), 1)
