"""Which of the two ways along a field hair grows: away from the scalp.

A line of the field is a hair, as far as anybody can tell: one way along it leads to the
root, the other to the tip, and the tip's is the one that comes farther from the scalp.
How much farther than where one stands is what counts: towards the root a hair comes
hardly any, so that most lines are as clear near the scalp as far from it. But 3 cm
farther are a tip for sure: of two ways that both come so far, over a parting, neither
is the tip's because it comes farther still.
Of what it gained a line takes back what it loses again, unless it came so far: a tip is
where hair ends, whereas towards the root it may pass over thick hair first. A few
millimetres it may lose for nothing, as on its way over a lock.
Nor need a tip be far from the scalp: short hair lies over the nape, nearer to the skin
than where it grew over other hair. But a line that leaves the hull straight through its
border, in the air, ends there; a hair does so at its tip, and at its root in the skin.
Locks of curls leave it anywhere, as its border is that of their turns.
Lines go astray, over a parting above all, where the field is hardly sure: so what they
find counts less the more doubt they passed, they say less where they start in doubt,
and each place asks the lines around it: of all that they find, how much more is ahead
than behind? So short lines in the skin, which find a millimetre, do not outvote long
ones over them. Lines that graze the hull's border, which is made of voxels, go on along
it, in as much doubt as where the field says nothing, though not beside the skin, where
hair begins.
Where a tail leaves the head (`tails.py`), the hair around goes to its tie, the nearer
the surer: a line gains by coming to a tie as by coming farther from the scalp, and hair
beside one grows towards it. From the nape it grows up to the tie, though lines there
lead down as well, into the few loose hairs that are farther from the scalp. Where no
tail leaves it, the tie may be where flat hair is drawn to (`updos.py`). In a knot hair
is wound up about its tie: only to come into it is a gain.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .evidence import Field
from .grid import blurred, uphill
from .hull import Hull
from .tails import find_tails, pull_of
from .updos import find_updos

EVERY = 2  # voxels along each axis of which one is the start of a line
LONGEST = 0.5  # metres, either way
DOUBT = 0.008  # metres of a field that says nothing after which a third is believed
REACHED = 0.03  # metres farther from the scalp than the start: surely a tip
LOSES = 0.003  # metres that a line may lose again after it came farthest
SAME = 0.0015  # metres by which such differences hardly differ
AROUND = 0.03  # metres, the Gaussian over which lines agree
GRAZING = 0.3  # least cosine to the hull's normal at which a line leaves it
ALOFT = 0.01  # metres above the skin from which on lines go along the hull
STEEP = (0.4, 0.9)  # such cosines at which they end: hardly, and surely
SURE = (0.0, 1.0)
WITHIN = 0.6  # voxels inside the hull to which a line that grazes it returns
GATHERED = 0.06  # metres farther from the scalp that a tie counts as
DRAWN = 0.5  # of what lines say: that hair beside a tie grows straight to it


def growth_sense(
    hull: Hull,
    field: Field,
    away: Float[np.ndarray, " voxels"],
    curly: bool = False,
) -> Float[np.ndarray, " voxels"]:
    """Return how clearly hair grows along the field in each voxel, from -1 to 1.

    Args:
        hull: Where hair can be.
        field: Directions; their signs say nothing.
        away: How far each voxel of hair is from the scalp, in metres.
        curly: Whether hair curls: no line ends in the air then.

    Returns:
        Near 1 where the lines around go away from the scalp ahead and not behind, near
        -1 where it is the other way round, 0 where both ways are alike.
    """
    voxels = np.argwhere(hull.hair)
    some = (voxels % EVERY == 0).all(axis=1)
    start = hull.grid.centres(hull.hair)[some]
    heading = field.direction[hull.hair][some]
    tails = find_tails(hull, away)
    if not len(tails.ties) and not curly:
        tails = find_updos(hull, field, away)
    pull = pull_of(tails, hull.grid.centres(hull.hair))
    distance = np.zeros(hull.grid.shape)
    gathered = tails.hair if tails.wound else pull.nearness
    distance[hull.hair] = away + GATHERED * gathered
    outwards = uphill(hull.distance)
    ahead, behind = (
        _farther(hull, outwards, field, distance, start, way * heading, curly)
        for way in (1.0, -1.0)
    )
    told = (ahead - behind) * field.anisotropy[hull.hair][some]
    started = np.zeros(hull.grid.shape, bool)
    started[tuple(voxels[some].T)] = True
    drawn = np.where(tails.hair, 0.0, DRAWN * pull.nearness)
    drawn *= (pull.towards * field.direction[hull.hair]).sum(axis=1)
    found = ahead + behind + SAME
    return _shares_around(hull, field, started, told[:, None] * heading, found) + drawn


def _shares_around(
    hull: Hull,
    field: Field,
    started: Bool[np.ndarray, "x y z"],
    told: Float[np.ndarray, "lines 3"],
    found: Float[np.ndarray, " lines"],
) -> Float[np.ndarray, " voxels"]:
    """Return what lines tell, of what they find, along the field in voxels of hair.

    Args:
        hull: Where hair is.
        field: Directions.
        started: Where lines start.
        told: How much more they find ahead, times the way that is, in metres.
        found: How much they find both ways, in metres.
    """
    sigma = AROUND / hull.grid.spacing
    whole = blurred(started, found, sigma)[hull.hair]
    more = sum(
        blurred(started, told[:, axis], sigma)[hull.hair]
        * field.direction[hull.hair][:, axis]
        for axis in range(3)
    )
    return more / np.maximum(whole, 1e-12)


def _farther(
    hull: Hull,
    outwards: Float[np.ndarray, "x y z 3"],
    field: Field,
    distance: Float[np.ndarray, "x y z"],
    start: Float[np.ndarray, "lines 3"],
    heading: Float[np.ndarray, "lines 3"],
    curly: bool,
) -> Float[np.ndarray, " lines"]:
    """Return how much farther from the scalp lines come on one way along a field.

    At most `REACHED`, in metres, times how far the way there can be believed. A line
    that never came so far takes back what it loses until it ends, but for `LOSES`; one
    that ends in the air has come so far.

    Args:
        hull: Lines end where they leave its hair, but go on where they graze it.
        outwards: Unit normal of its border in every voxel.
        field: Directions; their signs say nothing.
        distance: From the scalp, in the voxels of hair, in metres.
        start: Where lines start: places in hair.
        heading: The way they set out.
        curly: Whether no line ends in the air.
    """
    grid = hull.grid
    here = distance[tuple(grid.voxel(start).T)]
    farther, most, lost, tip = (np.zeros(len(start)) for _ in range(4))
    point, rows, belief = start, np.arange(len(start)), np.ones(len(start))
    fading = np.exp((field.anisotropy - 1.0) * grid.spacing / DOUBT)
    grazing = np.exp(-grid.spacing / DOUBT)
    for _ in range(int(LONGEST / grid.spacing)):
        point, grazes = _kept(hull, outwards, point + grid.spacing * heading, heading)
        at, inside = hull.grid.locate(point)
        belief = np.where(grazes, belief * grazing, belief)
        on = inside & hull.hair[at]
        ends = inside & ~hull.hair[at]
        beyond = tuple(axis[ends] for axis in at)
        steep = (outwards[beyond] * heading[ends]).sum(axis=1)
        # Such a place is up to a voxel higher than where the line left the hair.
        height = hull.head[beyond] - grid.spacing
        tip[rows[ends]] = belief[ends] * _in_the_air(height, steep)
        if not on.any():
            break
        at = tuple(axis[on] for axis in at)
        rows, point, heading = rows[on], point[on], heading[on]
        belief = belief[on] * fading[at]
        gained = np.minimum(distance[at] - here[rows], REACHED)
        farther[rows] = np.maximum(farther[rows], belief * gained)
        most[rows] = np.maximum(most[rows], gained)
        back = np.maximum(most[rows] - gained - LOSES, 0.0)
        lost[rows] = np.where(most[rows] < REACHED, belief * back, 0.0)
        heading = field.onwards(at, heading)
    return np.maximum(farther - lost, 0.0 if curly else REACHED * tip)


def _in_the_air(
    height: Float[np.ndarray, " lines"], steep: Float[np.ndarray, " lines"]
) -> Float[np.ndarray, " lines"]:
    """Return how surely lines that leave the hull end there as tips do, 0 to 1.

    Args:
        height: How far above the skin they leave it, in metres.
        steep: Cosine between their way and its outward normal.
    """
    return np.interp(height, (0.0, ALOFT), SURE) * np.interp(steep, STEEP, SURE)


class Kept(NamedTuple):
    """Where lines come to, and which of them had grazed the hull."""

    point: Float[np.ndarray, "lines 3"]
    grazes: Bool[np.ndarray, " lines"]


def _kept(
    hull: Hull,
    outwards: Float[np.ndarray, "x y z 3"],
    point: Float[np.ndarray, "lines 3"],
    heading: Float[np.ndarray, "lines 3"],
) -> Kept:
    """Return points with those put back that left the hull at a low angle.

    Args:
        hull: The hull.
        outwards: Unit normal of its border in every voxel.
        point: Where lines come to.
        heading: The way they came.
    """
    at, inside = hull.grid.locate(point)
    normal = outwards[at]
    grazes = inside & ~hull.hair[at] & (hull.head[at] > ALOFT)
    grazes &= (normal * heading).sum(axis=1) < GRAZING
    off = hull.distance[at] + WITHIN * hull.grid.spacing
    return Kept(point - np.where(grazes, off, 0.0)[:, None] * normal, grazes)
