"""Curls in photographs: how large a turn is, and which way their locks run.

Where hair curls, what a pixel shows is the side of a turn, not the lock. Over the area
of a turn the angles average to the lock's own direction, or nearly so; along the lock
they repeat after a turn: `repeats` tells how long it is, and better which way the lock
runs. Waves repeat as well, but hardly leave their locks, and lean to neither side of
them as what winds does, see `winding`: they are taken as they look, and how high they
are is told like how large turns are, see `waves`.

Where nothing repeats, hair may still curl, too finely to be seen: maps are hardly sure
of any direction, nor are those of smoother photographs, which show what noise hides.
Such hair is taken to curl at no known pitch; its maps then say nothing of its locks.
So is hair taken that swings much about the hair around, in smoothed photographs as
well; if those are a little sure, maps do tell which way it runs.
All other hair is taken as it looks.

By how far hair crosses its locks one knows how steep its turns are, see `slopes`, and
so their radius. How they wind is found last, see `locks`.
"""

import dataclasses
import math
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..capture.orientation import (
    SIGMA_BLIND,
    OrientationMap,
    angle_of_line,
    estimate_orientation,
    spread_of_lines,
)
from ..model.locks import PITCH
from ..model.tree import HairTree, leaves
from ..types import along_paths
from .hull import Hull, pixel_sizes
from .repeats import find_pitch, repeating_lines, repeats
from .slopes import (
    SUREST_CURLS,
    Crossing,
    cross_locks,
    mean_cosine,
    radius_at,
    slope_of,
    wave_slope_of,
)
from .winding import leaning

# Standard deviation of the Gaussian over which angles are averaged, in metres: half of
# a turn of the curls that can be seen.
LOCK = 0.016
# What curls swing about their locks at least: the mean square of the sine of twice the
# angle. Drawn curls have 0.49, ringlets 0.64, waves 0.07: waves are nearer to their
# mean direction than to waves of another phase.
LEAST_SWING = 0.2
# Hair also curls, however little it swings, if it winds about its locks: if so much of
# its swing leans lock by lock (see `winding`; path-traced hair that winds has 0.14 to
# 0.22, hair that waves in planes 0.10 at most), and from this slope on, as hair that
# winds less is near to its locks in any case.
LEAST_LEAN, LEAST_SLOPE = 0.12, 0.35
# And whatever curls swings about the mean of the hair around so far: hair that lies
# alike does not, whatever repeats across it. Drawn ringlets have 0.13 and curls 0.39,
# path-traced hair that winds 0.11 to 0.21, waves 0.03 to 0.12.
LEAST_OWN = 0.08
# Slope from which on hair does not wave. Drawn waves have 0.4 to 0.7; of hair that does
# not repeat at all, 1.4 and more is found.
STEEPEST_WAVE = 1.0
# Maps that are surer in the mean show a direction. Drawn afros and ringlets have 0.07
# and 0.16; straight, waved and tied hair has more than 0.2 unless noise hides it.
SURE = 0.17
# Noise goes in photographs that are smoothed by a Gaussian of so many pixels: straight
# hair in it becomes three and more times as sure, afros and ringlets twice at most.
GRAIN, SURER = 4.0, 2.5
BLIND = 0.08  # and where they then are no surer than this, nothing was hidden
# Surer than this when smoothed, maps show which way locks of curls too fine to be seen
# run. Path-traced turns have 0.13 to 0.24, drawn ringlets and curls 0.1, afros
# 0.04 to 0.07.
FAINT = 0.115
# And hair that repeats nowhere curls so that swings so far about the mean of the hair
# around, in smoothed photographs as well. Short path-traced curls have 0.12 to 0.25 in
# either, smooth hair 0.08 at most, and 0.1 with noise of 6 % of white.
FRIZZY = 0.105
# And about the nearest hair: what is tousled swings from lock to lock, as do buns, and
# lies alike within each. About the mean over so many metres, and so many pixels at
# least, as maps are smooth themselves, short path-traced curls have 0.04 to 0.08 in
# either, tousled hair and buns 0.01 to 0.024, and 0.037 with noise of 6 % of white.
FRIZZY_NEAR, NEAR, NEAR_PIXELS = 0.033, 0.006, 13.0
UNSEEN = 0.0035  # radius of curls that are too fine to be seen, in metres
MOST_VIEWS = 4
# What the mean direction says of a lock, against the way in which turns repeat: this
# times the mean cosine of twice the angle between hair and locks, at least the second.
MEAN_COUNTS, LEAST_MEAN = 4.0, 0.1
# And against that way in how far both disagree: curls swing about their mean, which
# says nothing against it.
DOUBT_COUNTS = 0.2
# Points that a turn needs, and most of a strand.
TURN_POINTS = 8
MOST_POINTS = 160


class Curls(NamedTuple):
    """How curly hair is that photographs show.

    Attributes:
        radius: Of its curls in metres, 0 for what does not curl.
        pitch: Length of a turn in metres, 0 for what does not curl.
        maps: Orientation maps of its locks.
        told: Whether they tell which way it runs; if not, they say nothing.
        wave: Length after which hair repeats that waves but does not curl, in metres, 0
            for all other hair.
        height: Of such waves, from their middle lines to their crests, in metres.
    """

    radius: float
    pitch: float
    maps: list[OrientationMap]
    told: bool
    wave: float = 0.0
    height: float = 0.0


class SeenLocks(NamedTuple):
    """The locks of curls in photographs.

    Attributes:
        maps: Orientation maps of them, one for each photograph.
        slope: Of their curls: metres across a metre along.
        crossing: At which angles hair crosses them.
        lean: How much of what hair swings about them leans, lock by lock.
    """

    maps: list[OrientationMap]
    slope: float
    crossing: Crossing
    lean: float


def see_curls(
    hull: Hull,
    views: Sequence[View],
    maps: Sequence[OrientationMap],
) -> Curls:
    """Return how curly the photographed hair is, and which way its locks run.

    Args:
        hull: Where hair can be.
        views: The photographs.
        maps: Their orientation maps.
    """
    pixels = pixel_sizes(hull, views)
    few = range(0, len(views), -(-len(views) // MOST_VIEWS))
    some = [views[k] for k in few], [maps[k] for k in few]
    sizes = [pixels[k] for k in few]

    sums = abreast(repeats, [view.hair for view in some[0]], some[1], sizes)
    pitch = find_pitch(list(sums))

    wave = height = 0.0
    if pitch is not None:
        locks = see_locks([view.hair for view in views], maps, pixels, pitch)
        winds = locks.lean > LEAST_LEAN and locks.slope > LEAST_SLOPE
        swings = swing(some[1], [locks.maps[k].angle for k in few]) > LEAST_SWING
        if (winds or swings) and own_swing(*some, sizes) > LEAST_OWN:
            return Curls(radius_at(locks.slope, pitch), pitch, locks.maps, True)
        wave, height = pitch, wave_height(locks.crossing, pitch)
    shown = what_shows(*some, sizes, pitch is not None)
    if shown.told and not shown.frizz:
        return Curls(0.0, 0.0, list(maps), True, wave, height)
    fine = UNSEEN, PITCH * UNSEEN
    if shown.told:
        return Curls(*fine, list(maps), True)
    mute = [dataclasses.replace(m, confidence=0.0 * m.confidence) for m in maps]
    return Curls(*fine, mute, False)


def see_locks(
    hair: Sequence[Bool[np.ndarray, "height width"]],
    maps: Sequence[OrientationMap],
    pixels: Sequence[float],
    pitch: float,
) -> SeenLocks:
    """Return the locks of hair whose curls repeat.

    Args:
        hair: Which pixels of each photograph are hair.
        maps: The orientation maps.
        pixels: Widths of a pixel, in metres.
        pitch: Length of a turn, in metres.
    """
    pitches = [pitch] * len(hair)
    again = list(abreast(repeating_lines, hair, maps, pixels, pitches))
    crossing, wider, sharpest = (
        np.sum(list(abreast(cross, hair, maps, again)), axis=0)
        for cross in (
            cross_locks,
            partial(cross_locks, surest=SUREST_CURLS),
            # What the mean direction counts was found with confidence as it is.
            partial(cross_locks, trust=1.0),
        )
    )
    leans = list(abreast(leaning, hair, maps, again, pixels, pitches))
    lean, whole = np.sum(leans, axis=0)
    given = hair, maps, pixels, again, [mean_cosine(sharpest)] * len(hair)
    directions = list(abreast(lock_directions, *given))
    return SeenLocks(directions, slope_of(wider), crossing, lean / max(whole, 1e-12))


def wave_height(crossing: Crossing, wave: float) -> float:
    """Return how high waves are, from their middle lines to their crests, in metres.

    None at all where hair crosses what should be its locks too steeply: these repeat
    by chance.

    Args:
        crossing: At which angles hair crosses its locks.
        wave: Length of a wave, in metres.
    """
    slope = wave_slope_of(crossing)
    return radius_at(slope, wave) if slope < STEEPEST_WAVE else 0.0


def swing(
    maps: Sequence[OrientationMap],
    angles: Sequence[Float[np.ndarray, "_height _width"]],
) -> float:
    """Return the mean square of the sine of twice the angle between hair and lines.

    Args:
        maps: The orientation maps.
        angles: Of the lines: of locks, or of what hair swings about.
    """
    square = total = 0.0
    for found, angle in zip(maps, angles, strict=True):
        sine = np.sin(2.0 * (found.angle - angle))
        square += float((found.confidence * sine**2).sum())
        total += float(found.confidence.sum())
    return square / max(total, 1e-12)


def own_swing(
    views: Sequence[View], maps: Sequence[OrientationMap], pixels: Sequence[float]
) -> float:
    """Return how far hair swings about the mean of the hair around, see `swing`.

    Args:
        views: The photographs.
        maps: Their orientation maps.
        pixels: Widths of a pixel, in metres.
    """
    return swing(maps, _means(views, maps, pixels, [LOCK] * len(views)))


def is_frizzy(
    views: Sequence[View], maps: Sequence[OrientationMap], pixels: Sequence[float]
) -> bool:
    """Return whether hair swings far about the mean of the nearest hair, too.

    Args:
        views: The photographs.
        maps: Their orientation maps.
        pixels: Widths of a pixel, in metres.
    """
    if own_swing(views, maps, pixels) <= FRIZZY:
        return False
    near = [max(NEAR, NEAR_PIXELS * pixel) for pixel in pixels]
    return swing(maps, _means(views, maps, pixels, near)) > FRIZZY_NEAR


def _means(
    views: Sequence[View],
    maps: Sequence[OrientationMap],
    pixels: Sequence[float],
    around: Sequence[float],
) -> list[Float[np.ndarray, "_height _width"]]:
    """Return the angles about which hair swings in each photograph, see `mean_line`."""
    hair = [view.hair for view in views]
    lines = abreast(mean_line, hair, maps, pixels, around)
    return [angle_of_line(line[..., 0], line[..., 1]) for line in lines]


def mean_confidence(views: Sequence[View], maps: Sequence[OrientationMap]) -> float:
    """Return how sure maps are in the mean of the hair's pixels."""
    sure = sum(float(m.confidence.sum()) for m in maps)
    return sure / max(sum(int(view.hair.sum()) for view in views), 1)


class Shown(NamedTuple):
    """What photographs show of hair, if not for their noise.

    Attributes:
        told: Whether they show which way it runs.
        frizz: Whether it curls too finely to be seen.
    """

    told: bool
    frizz: bool


def what_shows(
    views: Sequence[View],
    maps: Sequence[OrientationMap],
    pixels: Sequence[float],
    again: bool,
) -> Shown:
    """Return what photographs show of hair that has no curls to be seen.

    Args:
        views: The photographs.
        maps: Their orientation maps.
        pixels: Widths of a pixel, in metres.
        again: Whether it repeats, as waves do.
    """
    sharp = mean_confidence(views, maps)
    swings = not again and is_frizzy(views, maps, pixels)
    if sharp > SURE and not swings:
        return Shown(told=True, frizz=False)
    images = [ndimage.gaussian_filter(v.image, (GRAIN, GRAIN, 0)) for v in views]
    maps = [estimate_orientation(i, v.hair) for i, v in zip(images, views, strict=True)]
    smooth = mean_confidence(views, maps)
    if sharp > SURE or smooth > min(SURE, max(BLIND, SURER * sharp)):
        return Shown(True, swings and is_frizzy(views, maps, pixels))
    told = smooth > FAINT
    return Shown(told, frizz=not told or is_frizzy(views, maps, pixels))


def lock_directions(
    hair: Bool[np.ndarray, "height width"],
    found: OrientationMap,
    pixel: float,
    again: Float[np.ndarray, "height width 2"],
    cosine: float,
) -> OrientationMap:
    """Return the map of the locks' directions: what curls swing about.

    The way in which turns repeat counts by how far it is the only one, and the mean
    direction the more the less hair runs across its locks: of steep curls it is that of
    their fronts. How far all disagree is the error to expect.

    Args:
        hair: Which pixels are hair.
        found: The orientation map.
        pixel: Width of a pixel, in metres.
        again: Along which way turns repeat, see `repeating_lines`.
        cosine: Of twice the angle between hair and its locks, in the mean.
    """
    mean = mean_line(hair, found, pixel)
    counts = max(MEAN_COUNTS * cosine, LEAST_MEAN)
    line = counts * mean + again
    angle = angle_of_line(line[..., 0], line[..., 1])
    # Where all ways are alike, the mean says all there is.
    line = DOUBT_COUNTS * mean + again
    length = np.hypot(again[..., 0], again[..., 1])
    agree = np.hypot(line[..., 0], line[..., 1]) / (DOUBT_COUNTS + length)
    spread = np.minimum(spread_of_lines(agree), SIGMA_BLIND)
    sigma = np.where(hair, spread, SIGMA_BLIND)
    return OrientationMap(
        angle,
        np.where(hair, agree, 0.0).astype(np.float32),
        sigma.astype(np.float32),
    )


def mean_line(
    hair: Bool[np.ndarray, "height width"],
    found: OrientationMap,
    pixel: float,
    around: float = LOCK,
) -> Float[np.ndarray, "height width 2"]:
    """Return the mean of cosine and sine of twice the angle about each pixel.

    Every pixel of hair that says anything counts alike, as one side of a turn is seen
    sharper than the other.

    Args:
        hair: Which pixels are hair.
        found: The orientation map.
        pixel: Width of a pixel, in metres.
        around: The standard deviation of the Gaussian, in metres: as it is, a turn.
    """
    blur = around / pixel
    says = (hair & (found.confidence > 0.0)).astype(np.float32)
    cosine, sine, count = (
        ndimage.gaussian_filter(says * part, blur, truncate=3.0)
        for part in (np.cos(2.0 * found.angle), np.sin(2.0 * found.angle), 1.0)
    )
    return np.stack([cosine, sine], axis=2) / np.maximum(count, 1e-6)[..., None]


def points_for(tree: HairTree, pitch: float, least: int) -> int:
    """Return how many points strands need so that curls of a pitch are round.

    Args:
        tree: The tree that strands come from.
        pitch: Length of a turn, in metres; 0 where they do not curl.
        least: What straight strands need. As many or a multiple come back, of which
            there are few, as each is compiled.
    """
    if pitch <= 0.0:
        return least
    skeleton = np.asarray(tree.cylinder.skeleton, np.float64)[leaves(tree)]
    turns = np.quantile(along_paths(skeleton)[:, -1], 0.9) / pitch
    times = math.ceil(TURN_POINTS * turns / least)
    return least * max(1, min(times, MOST_POINTS // least))
