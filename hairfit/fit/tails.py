"""Tails: much hair that leaves the head through a narrow place, as a tie leaves it.

Photographs hardly show how hair comes to a tie, but the hull shows the tie. Of all hair
farther from the scalp than a few centimetres, a tail is a piece of its own with a
narrow base and much behind it. Locks that hang have less behind their bases, and hair
that falls all around, or stands off, has wide ones.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from ..render.raster import unit
from .bridges import pieces_of
from .hull import Hull

# Distances from the scalp beyond which tails are looked for, nearest first, in metres:
# there a tie is, or just before.
LEVELS = np.arange(0.015, 0.041, 0.0025)
WIDEST = 25e-4  # square metres of the base of a tail, at most
LONG = 0.15  # metres, of a tail's volume over its base, at least
LEAST = 0.05  # of the hull's volume is a tail, at least
NEAR = 0.045  # metres from a tie, the length of a Gaussian: hair there goes to it


class Tails(NamedTuple):
    """Where tails are, and where they begin.

    Attributes:
        hair: Which voxels of hair are of a tail.
        ties: The middles of their narrowest bases, in metres.
        wound: Whether they are knots, in which hair ends that runs to their ties.
    """

    hair: Bool[np.ndarray, " voxels"]
    ties: Float[np.ndarray, "tails 3"]
    wound: bool = False


def no_tails(voxels: int) -> Tails:
    """Return that none of so many voxels of hair are of a tail."""
    return Tails(np.zeros(voxels, bool), np.zeros((0, 3)))


class Beyond(NamedTuple):
    """The pieces of the hull beyond a distance from the scalp.

    Attributes:
        piece: The number of the piece of each voxel of hair, 0 for none.
        begins: Which voxels are no farther than the nearest beyond it.
        size: The voxels of each piece; of number 0, those of none.
        base: How many of them begin it.
    """

    piece: Int[np.ndarray, " voxels"]
    begins: Bool[np.ndarray, " voxels"]
    size: Int[np.ndarray, " pieces"]
    base: Int[np.ndarray, " pieces"]


def pieces_beyond(
    hull: Hull, away: Float[np.ndarray, " voxels"], level: float
) -> Beyond:
    """Return the pieces of the hull beyond a distance from the scalp, in metres."""
    beyond = np.zeros(hull.grid.shape, bool)
    beyond[hull.hair] = away > level
    piece = pieces_of(beyond)[hull.hair]
    begins = away <= level + hull.grid.spacing
    size = np.bincount(piece)
    return Beyond(piece, begins, size, np.bincount(piece[begins], minlength=len(size)))


def find_tails(hull: Hull, away: Float[np.ndarray, " voxels"]) -> Tails:
    """Return the tails of a hull.

    Args:
        hull: Where hair can be.
        away: How far each voxel of hair is from the scalp, in metres.
    """
    spacing, centres = hull.grid.spacing, hull.grid.centres(hull.hair)
    tail = np.zeros(len(away), int)  # its number, from 1 on
    narrowest, ties = [], []
    for level in LEVELS:
        piece, begins, size, base = pieces_beyond(hull, away, float(level))
        fits = (base > 0) & (base * spacing**2 <= WIDEST)
        fits &= (size * spacing >= LONG * base) & (size >= LEAST * len(away))
        fits[0] = False
        for label in np.flatnonzero(fits):
            mine = piece == label
            middle = centres[begins & mine].mean(axis=0)
            number = int(tail[mine].max())  # farther out, all of it is of one tail
            if not number:
                tail[mine] = len(ties) + 1
                narrowest.append(base[label])
                ties.append(middle)
            elif base[label] < narrowest[number - 1]:
                narrowest[number - 1], ties[number - 1] = base[label], middle
    return Tails(tail > 0, np.reshape(ties, (-1, 3)))


class Pull(NamedTuple):
    """How near hair is to a tie, and the way there.

    Attributes:
        nearness: 1 at the tie and in its tail, 0 far from it.
        towards: Unit vectors to the nearest tie.
    """

    nearness: Float[np.ndarray, " voxels"]
    towards: Float[np.ndarray, "voxels 3"]


def pull_of(tails: Tails, centres: Float[np.ndarray, "voxels 3"]) -> Pull:
    """Return where tails draw hair.

    Args:
        tails: The tails.
        centres: Of the voxels of hair, in metres.
    """
    if not len(tails.ties):
        return Pull(np.zeros(len(centres)), np.zeros_like(centres))
    gap, nearest = KDTree(tails.ties).query(centres, workers=-1)
    nearness = np.where(tails.hair, 1.0, np.exp(-((gap / NEAR) ** 2)))
    return Pull(nearness, unit(tails.ties[nearest] - centres))
