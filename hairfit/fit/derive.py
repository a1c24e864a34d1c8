"""Strands of a tree that stay out of the head."""

from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from ..capture.distance import Skin, push_out
from ..errors import InputError
from ..model.strand import sample_hair
from ..model.tree import HairTree
from ..types import Mesh, Strands, resample_paths

# A strand that leaves the tree inside the skin is laid this far above it. Metres.
SKIN_GAP = 0.0005
# What still runs deeper than this is cut off: thin parts of a mesh, sharp corners.
DEEPEST = 0.0007
HIGHEST_ROOT = 0.0018  # metres above the skin
PIECES = 24  # a segment near the skin is looked at in so many pieces
HALVED = (2, 4, 8)  # and before in so few, whole shares of them, which exclude most
SPARE = 1.03  # for strands that must go as a whole
LIFTS = 6  # how often strands are lifted over corners that they would cut
FARTHEST_LIFT = 0.004  # metres that a point is lifted each time, at most


class Derived(NamedTuple):
    """Strands of a tree.

    Attributes:
        strands: The strands, of equal counts of points.
        owner: The leaf cluster of each.
    """

    strands: Strands
    owner: Int[np.ndarray, " strands"]


def derive_strands(
    tree: HairTree, head: Mesh | None, count: int, points: int, seed: int
) -> Strands:
    """Return strands of a tree, see `derive_hair`."""
    return derive_hair(tree, head, count, points, seed).strands


def derive_hair(
    tree: HairTree, head: Mesh | None, count: int, points: int, seed: int
) -> Derived:
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
    wanted = count if head is None else with_spare(count)
    hair = sample_hair(tree, wanted, points, jax.random.key(seed))
    found, owner = np.array(hair.strands), np.asarray(hair.owner)
    if not len(found):
        raise InputError(
            "no strand grows from the tree: its clusters cover nothing of the scalp; "
            "fit it again."
        )
    if head is not None:
        out = _outside(found.astype(np.float64), Skin(head))
        kept = out.kept[:count]
        found, owner = out.strands[kept], owner[kept]
    return Derived(Strands.from_array(found), owner)


def with_spare(count: int) -> int:
    """Return how many strands are grown so that `count` are left outside a head."""
    return int(SPARE * count) + 1


class Outside(NamedTuple):
    """Strands on the skin, and the indices of those that are more than stubs."""

    strands: Float[np.ndarray, "strands points 3"]
    kept: Int[np.ndarray, " kept"]


def _outside(strands: Float[np.ndarray, "strands points 3"], skin: Skin) -> Outside:
    """Return the strands laid onto the skin and cut where they dive."""
    points = strands.shape[1]
    strands, diving = lifted(strands, skin)
    last = np.where(_rooted(strands, skin), points - 1, 0)
    last[diving] = last_outside(strands[diving], skin)
    cut = np.flatnonzero(last < points - 1)
    for strand in cut:
        strands[strand, last[strand] :] = strands[strand, last[strand]]
    strands[cut] = resample_paths(strands[cut], points)
    keep = last > 0
    keep[cut] &= last_outside(strands[cut], skin) == points - 1
    return Outside(strands, np.flatnonzero(keep))


class Lifted(NamedTuple):
    """Strands out of the head, and the indices of those that may dive all the same."""

    strands: Float[np.ndarray, "strands points 3"]
    diving: Int[np.ndarray, " diving"]


def lifted(strands: Float[np.ndarray, "strands points 3"], skin: Skin) -> Lifted:
    """Return strands whose points, and whose segments if some steps can do it, are out.

    Both ends of a segment that runs under the skin move out by as much as its deepest
    spot has to; roots stay.

    Args:
        strands: The strands, in metres.
        skin: The head.
    """
    strands = laid(strands, skin)
    left = np.arange(len(strands))
    for _ in range(LIFTS):
        dives = find_dives(strands[left], skin)
        owner = left[dives.strand]
        left = np.unique(owner)
        if not len(left):
            break
        out = push_out(skin, dives.spot, SKIN_GAP) - dives.spot
        far = np.linalg.norm(out, axis=1, keepdims=True)
        out *= np.minimum(1.0, FARTHEST_LIFT / np.maximum(far, 1e-9))
        for end in (dives.segment, dives.segment + 1):
            moves = end > 0
            strands[owner[moves], end[moves]] += out[moves]
        strands[left, 1:] = laid(strands[left, 1:], skin)
    return Lifted(strands, left)


def laid(
    strands: Float[np.ndarray, "strands points 3"], skin: Skin
) -> Float[np.ndarray, "strands points 3"]:
    """Return strands with those points that are in the head laid onto its skin.

    They are as they will be stored: rounding shall not push a point back in.
    """
    points = push_out(skin, strands.reshape(-1, 3), SKIN_GAP)
    return points.reshape(strands.shape).astype(np.float32).astype(np.float64)


class Dives(NamedTuple):
    """Segments of strands that run under the skin, and the deepest spot of each."""

    strand: Int[np.ndarray, " dives"]
    segment: Int[np.ndarray, " dives"]
    spot: Float[np.ndarray, "dives 3"]


def find_dives(strands: Float[np.ndarray, "strands points 3"], skin: Skin) -> Dives:
    """Return the segments that run deeper in the head than is let pass."""
    count, points = strands.shape[:2]
    length = np.linalg.norm(np.diff(strands, axis=1), axis=2)
    away = skin.least_distance(strands.reshape(-1, 3)).reshape(count, points)
    may = _may_dive(np.stack([away[:, :-1], away[:, 1:]], axis=2), length)
    asked = np.zeros(away.shape, bool)
    asked[:, 1:] |= may
    asked[:, :-1] |= may
    away[asked] = skin.nearest(strands[asked]).distance
    strand, segment = np.nonzero(may)
    start = strands[strand, segment]
    step = strands[strand, segment + 1] - start
    length = length[may]
    known = np.stack([away[strand, segment], away[strand, segment + 1]], axis=1)
    left = np.flatnonzero(_may_dive(known, length))
    known = known[left]
    for pieces in HALVED:
        share = np.arange(1, pieces, 2) / pieces
        middle = skin.nearest(_along(start[left], step[left], share)).distance
        halves = np.zeros((len(left), pieces + 1))
        halves[:, ::2], halves[:, 1::2] = known, middle.reshape(-1, pieces // 2)
        still = _may_dive(halves, length[left])
        left, known = left[still], halves[still]
    # Between those places, only where it may run too deep.
    finer = PIECES // HALVED[-1]
    depth = np.full((len(left), PIECES + 1), np.inf)
    depth[:, finer::finer] = known[:, 1:]
    segments, part = np.nonzero(_pieces_that_may_dive(known, length[left]))
    place = (finer * part[:, None] + np.arange(1, finer)).ravel()
    segments = np.repeat(segments, finer - 1)
    share = place[:, None] / PIECES
    between = start[left[segments]] + share * step[left[segments]]
    depth[segments, place] = skin.nearest(between).distance
    deep = np.flatnonzero(depth.min(axis=1, initial=np.inf) < -DEEPEST)
    share = depth[deep].argmin(axis=1)[:, None] / PIECES
    spot = start[left[deep]] + share * step[left[deep]]
    return Dives(strand[left[deep]], segment[left[deep]], spot)


def _may_dive(
    away: Float[np.ndarray, "*segments places"], length: Float[np.ndarray, "*segments"]
) -> Bool[np.ndarray, "*segments"]:
    """Return which segments may run too deep, by distances at even places."""
    return np.any(_pieces_that_may_dive(away, length), axis=-1)


def _pieces_that_may_dive(
    away: Float[np.ndarray, "*segments places"], length: Float[np.ndarray, "*segments"]
) -> Bool[np.ndarray, "*segments pieces"]:
    """Return between which places segments may run too deep.

    Distance changes by no more than one walks.
    """
    reach = length / (away.shape[-1] - 1) - 2.0 * DEEPEST
    return away[..., 1:] + away[..., :-1] < reach[..., None]


def _along(
    start: Float[np.ndarray, "segments 3"],
    step: Float[np.ndarray, "segments 3"],
    share: Float[np.ndarray, " places"],
) -> Float[np.ndarray, "points 3"]:
    """Return points of segments, at the same shares of each."""
    return (start[:, None] + share[:, None] * step[:, None]).reshape(-1, 3)


def last_outside(
    strands: Float[np.ndarray, "strands points 3"], skin: Skin
) -> Int[np.ndarray, " strands"]:
    """Return the last point of each strand before it first dives into the head."""
    count, points = strands.shape[:2]
    if not count:
        return np.zeros(0, int)
    dives = find_dives(strands, skin)
    first = np.full(count, points - 1)
    np.minimum.at(first, dives.strand, dives.segment)
    return np.where(_rooted(strands, skin), first, 0)


def _rooted(
    strands: Float[np.ndarray, "strands points 3"], skin: Skin
) -> Bool[np.ndarray, " strands"]:
    """Return which strands have their roots on the skin."""
    # The patch is smooth and leaves out the mesh's pits: no hair grows over these.
    height = skin.nearest(strands[:, 0]).distance
    return (height >= -DEEPEST) & (height <= HIGHEST_ROOT)
