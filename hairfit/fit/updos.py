"""Ties of hair that is drawn up flat to them: high ponytails, buns, knots.

What hangs down beside the head, or is wound up on it, is no piece with a narrow base as
a tail is that stands off, see `tails`. But flat hair shows where it is drawn: nearly
all lines of the field that lead out of it, into hair that is higher, lead to one place,
or to one on each side, and the other way to where hair begins. Hair that falls leads
out of what is thin, at a parting or crown, to all sides, or both ways.
Where lines are lost on the way, or pass below what is wound up, a knot on an otherwise
flat head is one still; or a tail, if it is tall, whose base is too wide for `tails`.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from .bridges import pieces_of
from .evidence import Field
from .hull import Hull
from .stubble import thin_hair
from .tails import Tails, no_tails, pieces_beyond

HIGH = 0.020  # metres from the scalp beyond which hair is no longer flat
LONGEST = 0.3  # metres of a line
WIDE = 0.025  # metres from a tie within which lines come to it
SIDES = 2  # ties at most
# Of all lines that leave flat hair come to ties at least, all told; and to each of them
# from so much flat hair, in cubic metres. Hair drawn up has 0.66 to 0.97 and 35 cm³ or
# more; hair that falls 0.41 at most, but for 12 cm³ on a receding crown.
MOST, LEAST = 0.6, 25e-6
# What is farther from the scalp than one of these, in metres, is a knot: on a base of
# so many square metres at most, that many metres tall, with such a share of all hair
# and so many cubic metres: a ball of 4 cm.
KNOTS = np.arange(0.015, 0.046, 0.005)
KNOT_BASE, KNOT_TALL, KNOT_SHARE, KNOT_LEAST = 80e-4, 0.02, 0.05, 30e-6
# No more of the hair than this is as far elsewhere, and so many cubic metres are flat.
# Heads that have no knot have bases of 165 cm² and more, or less hair on them.
KNOT_REST, KNOT_LIES = 0.08, 50e-6
# Such as are taller are tails: knots have 22 to 65 mm, tails 74 mm and more. About a
# knot's tie what is no longer flat is of it, so far around.
KNOT_TAIL, KNOT_ROUND = 0.07, 0.04
ASKED = 300  # lines that are tried as the middle of a tie


def find_updos(hull: Hull, field: Field, away: Float[np.ndarray, " voxels"]) -> Tails:
    """Return the ties that flat hair is drawn to, and the hair beyond them.

    Args:
        hull: Where hair can be.
        field: Directions; their signs say nothing.
        away: How far each voxel of hair is from the scalp, in metres.
    """
    spacing, centres = hull.grid.spacing, hull.grid.centres(hull.hair)
    high = np.zeros(hull.grid.shape, bool)
    high[hull.hair] = away > HIGH
    flat = thin_hair(hull) & (away <= HIGH)
    ways = _arrivals(hull, field, high, centres[flat])
    count = np.isfinite(ways[..., 0]).sum(axis=0)
    left = np.nanmax(ways[:, count == 1], axis=0)
    ties, come, least = [], 0, LEAST / spacing**3
    while len(ties) < SIDES and len(left) > 0:
        tie, near = _densest(left)
        if near.sum() < least:
            break
        ties.append(tie)
        come += int(near.sum())
        left = left[~near]
    if not ties or come < MOST * (count > 0).sum():
        lies = spacing**3 * flat.sum() >= KNOT_LIES
        return find_knots(hull, away) if lies else no_tails(len(away))
    pieces = pieces_of(high)[hull.hair]
    beyond = np.flatnonzero(pieces)
    nearest = KDTree(centres[beyond]).query(np.array(ties))[1]
    mine = np.isin(pieces, pieces[beyond[nearest]])
    return Tails(mine & (pieces > 0), np.array(ties))


def find_knots(hull: Hull, away: Float[np.ndarray, " voxels"]) -> Tails:
    """Return the knots, or tails, on a head whose hair lies flat but for them.

    Args:
        hull: Where hair can be.
        away: How far each voxel of hair is from the scalp, in metres.
    """
    spacing, centres = hull.grid.spacing, hull.grid.centres(hull.hair)
    for level in KNOTS:
        piece, begins, size, base = pieces_beyond(hull, away, float(level))
        size[0] = 0
        stands = (base > 0) & (spacing**2 * base <= KNOT_BASE)
        stands &= spacing * size >= KNOT_TALL * base
        least = max(KNOT_SHARE * len(away), KNOT_LEAST / spacing**3)
        knots = np.flatnonzero(stands & (size >= least))
        rest = size.sum() - size[knots].sum()
        if 0 < len(knots) <= SIDES and rest <= KNOT_REST * len(away):
            ties = [centres[begins & (piece == one)].mean(axis=0) for one in knots]
            hair = np.isin(piece, knots)
            wound = bool((spacing * size < KNOT_TAIL * base)[knots].all())
            if wound:
                near = KDTree(ties).query(centres)[0] < KNOT_ROUND
                hair |= near & (away > HIGH)
            return Tails(hair, np.array(ties), wound)
    return no_tails(len(away))


def _arrivals(
    hull: Hull,
    field: Field,
    high: Bool[np.ndarray, "x y z"],
    start: Float[np.ndarray, "lines 3"],
) -> Float[np.ndarray, "ways lines 3"]:
    """Return where lines of the field come from flat to high hair, both ways.

    Not a number where they do not.
    """
    grid, arrived = hull.grid, np.full((2, len(start), 3), np.nan)
    for came, way in zip(arrived, (1.0, -1.0), strict=True):
        point, heading = start, way * field.direction[tuple(grid.voxel(start).T)]
        rows = np.arange(len(start))
        for _ in range(int(LONGEST / grid.spacing)):
            point = point + grid.spacing * heading
            at, inside = grid.locate(point)
            inside &= hull.hair[at]
            there = inside & high[at]
            came[rows[there]] = point[there]
            on = inside & ~high[at]
            rows, point, at = rows[on], point[on], tuple(axis[on] for axis in at)
            heading = field.onwards(at, heading[on])
    return arrived


def _densest(
    points: Float[np.ndarray, "points 3"],
) -> tuple[Float[np.ndarray, "3"], Bool[np.ndarray, " points"]]:
    """Return the middle of the densest place, and which points are within it."""
    tree = KDTree(points)
    tried = points[:: -(-len(points) // ASKED)]
    counts = tree.query_ball_point(tried, WIDE, return_length=True)
    middle = tried[int(np.argmax(counts))]
    for _ in range(5):
        middle = points[tree.query_ball_point(middle, WIDE)].mean(axis=0)
    near = np.zeros(len(points), bool)
    near[tree.query_ball_point(middle, WIDE)] = True
    return middle, near
