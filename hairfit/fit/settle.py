"""Each cluster of grown strands gets a piece of scalp of its own.

Nobody sees roots. Strands that grow beside each other and part on their way leave
clusters whose roots lie between one another, and in a tree, where a root's place says
which cluster it belongs to, most such roots go to the wrong one. So roots are laid out
anew: pieces of scalp around the clusters' middles, about as large as the clusters are
strong (a power diagram by entropic transport, Cuturi 2013), and in each piece the
strands where they fit the cluster's linear map. Long hair gives way, short hair hardly:
where roots would have to move far for the length of their strands, pieces are smaller
or larger than is their due (unbalanced transport, Chizat et al. 2018, Mathematics of
Computation 87).
"""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree

from ..model.scalp import Scalp, sample_roots
from ..types import along_paths
from .gather import Rooted, numbered, regress_maps
from .root_scalp import scalp_points
from .treeify import on_scalp

AROUND = 32  # clusters that a root may go to: those with the closest middles
# How blurred pieces are at first and at last, in distances of roots from the closest
# middle, and steps between.
COARSEST, FINEST, STEPS = 4.0, 0.25, 40
MOVES = 3  # times that middles make room for each other
# A piece with an e-th of the roots that are its due draws more as if it were nearer to
# them by this share of its strands' length (squares are subtracted).
SWAY = 0.1
RIDGE = 0.02  # of the spread of roots, in a cluster's map
ROUNDS = 2  # of matching strands and roots
SOFTEST, REACH = 0.03, 5.0  # metres, and displacements, along which a strand gives way


class Settled(NamedTuple):
    """Strands with their new roots, and their clusters, numbered without gaps."""

    rooted: Rooted
    label: Int[np.ndarray, " strands"]


def settled(
    scalp: Scalp,
    rooted: Rooted,
    label: Int[np.ndarray, " strands"],
    count: int,
    seed: int,
) -> Settled:
    """Return so many strands, of the same clusters, with roots evenly on the scalp.

    Of a cluster whose piece holds fewer roots than it has strands some are left out;
    where it holds more, some come twice. The shorter strands are, the nearer to their
    own roots they stay.

    Args:
        scalp: The scalp.
        rooted: The strands.
        label: Cluster of each strand, from 0 without gaps.
        count: How many strands.
        seed: Of all that is random.
    """
    uv = np.asarray(sample_roots(scalp, count, jax.random.key(seed)), np.float64)
    places = scalp_points(scalp, uv)
    strong = np.bincount(label)
    middles = np.stack([np.bincount(label, x) for x in rooted.knots[:, 0].T], axis=1)
    length = np.bincount(label, along_paths(rooted.knots)[:, -1]) / strong
    piece = pieces(places, middles / strong[:, None], strong, SWAY * length)
    maps = regress_maps(rooted, label)
    rng = np.random.default_rng(seed)
    strand, root = [], []
    for cluster in np.unique(piece):
        mine = np.flatnonzero(piece == cluster)
        members = drawn(np.flatnonzero(label == cluster), len(mine), rng)
        lines = rooted.knots[members, 1:].reshape(len(mine), -1)
        slope = maps.slope[cluster, 1:].reshape(-1, 2)
        strand.append(members)
        root.append(mine[matched(uv[mine], lines, slope)])
    chosen, at = np.concatenate(strand), np.concatenate(root)
    knots = led_to(rooted.knots[chosen], places[at])
    rooted = Rooted(uv[at], knots, on_scalp(scalp, uv[at]).slope)
    return Settled(rooted, numbered(piece[at]))


def pieces(
    places: Float[np.ndarray, "roots 3"],
    middles: Float[np.ndarray, "clusters 3"],
    strong: Int[np.ndarray, " clusters"],
    sway: Float[np.ndarray, " clusters"],
) -> Int[np.ndarray, " roots"]:
    """Return the cluster of each root: pieces around middles, about as large as asked.

    Clusters with one middle push each other apart. The weak ones may get nothing.

    Args:
        places: The roots, in metres.
        middles: Where the clusters would be, in metres.
        strong: How many strands each has.
        sway: What a piece is nearer by, in metres, if it has an e-th of its due.
    """
    firm = sway**2
    share = strong * (len(places) / strong.sum())
    weight = np.zeros(len(middles))
    at = middles
    for _ in range(MOVES):
        found = KDTree(at).query(places, k=min(AROUND, len(at)))
        away, near = (np.reshape(part, (len(places), -1)) for part in found)
        typical = np.mean(away[:, 0] ** 2) + 1e-12
        for blur in np.geomspace(COARSEST, FINEST, STEPS) ** 2 * typical:
            score = (weight[near] - away**2) / blur
            part = np.exp(score - score.max(axis=1, keepdims=True))
            part /= part.sum(axis=1, keepdims=True)
            got = np.bincount(near.ravel(), part.ravel(), minlength=len(at))
            weight += blur * np.log(share / np.maximum(got, 1e-3 * share))
            weight *= firm / (firm + blur)
        parts = [(part * axis[:, None]).ravel() for axis in places.T]
        total = np.stack([np.bincount(near.ravel(), p, len(at)) for p in parts], axis=1)
        mean = total / np.maximum(got, 1e-9)[:, None]
        at = 0.5 * (middles + np.where(got[:, None] > 1e-3 * share[:, None], mean, at))
    best = (weight[near] - away**2).argmax(axis=1)
    return near[np.arange(len(places)), best]


def drawn(
    members: Int[np.ndarray, " members"], count: int, rng: np.random.Generator
) -> Int[np.ndarray, " count"]:
    """Return so many members: some of them, or all and some twice."""
    if count <= len(members):
        return rng.choice(members, count, replace=False)
    return np.concatenate([members, rng.choice(members, count - len(members))])


def matched(
    uv: Float[np.ndarray, "strands 2"],
    lines: Float[np.ndarray, "strands coordinates"],
    slope: Float[np.ndarray, "coordinates 2"],
) -> Int[np.ndarray, " strands"]:
    """Return which root each strand of a cluster gets, so that a linear map holds them.

    Args:
        uv: The roots, as many as strands, in scalp space.
        lines: The strands.
        slope: How strands move with u and v, to start from.
    """
    away, rest = uv - uv.mean(axis=0), lines - lines.mean(axis=0)
    spread = away.T @ away
    spread += (RIDGE * np.trace(spread) + 1e-12) * np.eye(2)
    for _ in range(ROUNDS):
        # Squares of strands and of places are the same in all matchings.
        root = linear_sum_assignment(-rest @ slope @ away.T)[1]
        slope = np.linalg.solve(spread, away[root].T @ rest).T
    return root


def led_to(
    strands: Float[np.ndarray, "strands knots 3"], roots: Float[np.ndarray, "strands 3"]
) -> Float[np.ndarray, "strands knots 3"]:
    """Return strands that start at other roots and run smoothly back to their own way.

    Args:
        strands: The strands, root first, in metres.
        roots: Where they shall start, in metres.
    """
    moved = roots - strands[:, 0]
    far = np.maximum(SOFTEST, REACH * np.linalg.norm(moved, axis=1, keepdims=True))
    left = np.clip(1.0 - along_paths(strands) / far, 0.0, 1.0)
    return strands + (left**2 * (3.0 - 2.0 * left))[..., None] * moved[:, None]
