"""Curls in photographs: how long a turn is, and which way their locks run.

Where hair curls, what a pixel shows is the side of a turn, not the lock. Over the area
of a turn the angles average to the lock's own direction. Along the lock they swing
about it and repeat after a turn: the first peak of their autocorrelation is the pitch.

Curls that are finer, or steeper than 45 degrees, cross and hide one another: maps are
hardly sure of any direction, nor are those of smoother photographs, which show what
noise hides. Such hair is taken to curl at no known pitch; its maps then say nothing of
its locks. All other hair is taken as it looks.

Their slope is not recovered, as maps show half of it; a pitch gives the radius as it
does for the curls of single hairs, see `fur`. How they wind is found last, see `locks`.
"""

import dataclasses
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..capture.orientation import (
    SIGMA_BLIND,
    OrientationMap,
    estimate_orientation,
)
from ..model.fur import PITCH
from ..model.tree import HairTree, leaves
from ..types import along_paths
from .hull import Hull, pixel_sizes

# Standard deviation of the Gaussian over which angles are averaged, in metres: half of
# a turn of the curls that can be seen.
LOCK = 0.016
# What curls swing about their locks at least: the mean square of the sine of twice the
# angle. Drawn curls have 0.30, waves 0.07, all that is straight or tied 0.05 at most;
# waves are nearer to their mean direction than to waves of another phase.
LEAST_SWING = 0.15
# Maps that are surer in the mean show a direction. Drawn afros and ringlets have 0.07
# and 0.16; straight, waved and tied hair has more than 0.2 unless noise hides it.
SURE = 0.17
# Noise goes in photographs that are smoothed by a Gaussian of so many pixels: straight
# hair in it becomes three and more times as sure, afros and ringlets twice at most.
GRAIN, SURER = 4.0, 2.5
BLIND = 0.08  # and where they then are no surer than this, nothing was hidden
UNSEEN = 0.0035  # radius of curls that are too fine or too steep to be seen, in metres
# The autocorrelation falls below the first between turns, and rises above the second.
BETWEEN, AGAIN = -0.05, 0.2
STEP = 0.001  # metres between two places along a lock
REACH = 100  # steps that are followed
FEW = 0.1  # of all locks, which say nothing of those places that only they reach
STARTS = 3000  # pixels of each photograph from which locks are followed
# Metres from the border of the hair: nearer to it no lock starts, beyond it all end.
RIM = 0.004
MOST_VIEWS = 4
# Points that a turn needs, and most of a strand.
TURN_POINTS = 8
MOST_POINTS = 160


class Curls(NamedTuple):
    """How curly hair is that photographs show.

    Attributes:
        radius: Of its curls in metres, 0 for what does not curl.
        maps: Orientation maps of its locks.
        told: Whether they tell which way it runs; if not, they say nothing.
    """

    radius: float
    maps: list[OrientationMap]
    told: bool


class Along(NamedTuple):
    """What angles do along locks, summed over places with weights.

    Attributes:
        product: Of the sines of twice the angle to the lock, for each lag in steps.
        weight: Of the pairs of places at each lag.
    """

    product: Float[np.ndarray, " lags"]
    weight: Float[np.ndarray, " lags"]


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
    straight = Curls(0.0, list(maps), True)
    pixels = pixel_sizes(hull, views)
    few = range(0, len(views), -(-len(views) // MOST_VIEWS))
    some = [views[k] for k in few], [maps[k] for k in few]

    def locks(those: Sequence[int]) -> list[OrientationMap]:
        given = ((views[k].hair, maps[k], pixels[k]) for k in those)
        return list(abreast(lambda one: lock_directions(*one), given))

    mean = locks(few)
    if swing(some[1], mean) > LEAST_SWING:
        radius = find_radius(
            [
                follow_locks(views[k].hair, maps[k], lock, pixels[k])
                for k, lock in zip(few, mean, strict=True)
            ]
        )
        if radius > 0.0:
            return Curls(radius, locks(range(len(views))), True)
    if show_direction(*some):
        return straight
    mute = [dataclasses.replace(m, confidence=0.0 * m.confidence) for m in maps]
    return Curls(UNSEEN, mute, False)


def swing(maps: Sequence[OrientationMap], locks: Sequence[OrientationMap]) -> float:
    """Return the mean square of the sine of twice the angle between hair and locks."""
    square = total = 0.0
    for found, lock in zip(maps, locks, strict=True):
        sine = np.sin(2.0 * (found.angle - lock.angle))
        square += float((found.confidence * sine**2).sum())
        total += float(found.confidence.sum())
    return square / max(total, 1e-12)


def mean_confidence(views: Sequence[View], maps: Sequence[OrientationMap]) -> float:
    """Return how sure maps are in the mean of the hair's pixels."""
    sure = sum(float(m.confidence.sum()) for m in maps)
    return sure / max(sum(int(view.hair.sum()) for view in views), 1)


def show_direction(views: Sequence[View], maps: Sequence[OrientationMap]) -> bool:
    """Return whether photographs show which way hair runs, if not for their noise.

    Args:
        views: The photographs.
        maps: Their orientation maps.
    """
    sharp = mean_confidence(views, maps)
    if sharp > SURE:
        return True
    images = [ndimage.gaussian_filter(v.image, (GRAIN, GRAIN, 0)) for v in views]
    smooth = mean_confidence(
        views,
        [estimate_orientation(i, v.hair) for i, v in zip(images, views, strict=True)],
    )
    return smooth > min(SURE, max(BLIND, SURER * sharp))


def find_radius(along: Sequence[Along]) -> float:
    """Return the radius of curls in metres by their pitch, 0 where nothing repeats.

    Args:
        along: What angles do along the locks of some photographs.
    """
    product, weight = (np.sum(sums, axis=0) for sums in zip(*along, strict=True))
    many = weight > FEW * weight[0]
    pitch = find_period(np.where(many, product / np.maximum(weight, 1e-12), 0.0))
    return 0.0 if pitch is None else STEP * pitch / PITCH


def lock_directions(
    hair: Bool[np.ndarray, "height width"], found: OrientationMap, pixel: float
) -> OrientationMap:
    """Return the map of the locks' directions: what curls swing about.

    Every pixel of hair that says anything counts alike, as one side of a turn is seen
    sharper than the other. How far they disagree is the error to expect.

    Args:
        hair: Which pixels are hair.
        found: The orientation map.
        pixel: Width of a pixel, in metres.
    """
    blur = LOCK / pixel
    says = (hair & (found.confidence > 0.0)).astype(np.float32)
    cosine, sine, count = (
        ndimage.gaussian_filter(says * part, blur, truncate=3.0)
        for part in (np.cos(2.0 * found.angle), np.sin(2.0 * found.angle), 1.0)
    )
    angle = np.mod(np.arctan2(sine, cosine) / 2.0, np.pi)
    agree = np.hypot(cosine, sine) / np.maximum(count, 1e-6)
    spread = np.sqrt(-2.0 * np.log(np.clip(agree, 1e-3, 1.0))) / 2.0
    sigma = np.where(hair, np.minimum(spread, SIGMA_BLIND), SIGMA_BLIND)
    return OrientationMap(
        angle.astype(np.float32),
        np.where(hair, agree, 0.0).astype(np.float32),
        sigma.astype(np.float32),
    )


def follow_locks(
    hair: Bool[np.ndarray, "height width"],
    found: OrientationMap,
    lock: OrientationMap,
    pixel: float,
) -> Along:
    """Return how the angle at a place and farther along its lock go together.

    Args:
        hair: Which pixels are hair; locks are followed across gaps as wide as `RIM`.
        found: The orientation map.
        lock: The map of the locks' directions.
        pixel: Width of a pixel, in metres.
    """
    rim = max(1, round(RIM / pixel))
    inner = np.asarray(ndimage.binary_erosion(hair, iterations=rim), bool)
    near = np.asarray(ndimage.binary_dilation(hair, iterations=rim))
    places = np.argwhere(inner & (found.confidence > 0.0))
    product, weight = np.zeros(REACH + 1), np.zeros(REACH + 1)
    if not len(places):
        return Along(product, weight)
    some = np.random.default_rng(0).choice(len(places), min(STARTS, len(places)))
    row, column = places[some].T.astype(np.float64)
    goes = np.ones(len(row), bool)
    heading = first = start = np.zeros(len(row))
    for lag in range(REACH + 1):
        y, x = (
            np.clip(np.rint(at).astype(int), 0, size - 1)
            for at, size in zip((row, column), hair.shape, strict=True)
        )
        goes &= near[y, x]
        # A lock's line has no sense: it goes on as it went.
        angle = lock.angle[y, x].astype(np.float64)
        back = (np.cos(angle - heading) < 0.0) & (lag > 0)
        heading = np.where(back, angle + math.pi, angle)
        sine = np.sin(2.0 * (found.angle[y, x] - heading))
        sure = found.confidence[y, x] * goes
        if not lag:
            first, start = sine, sure
        product[lag] = (start * sure * first * sine).sum()
        weight[lag] = (start * sure).sum()
        row = row + STEP / pixel * np.sin(heading)
        column = column + STEP / pixel * np.cos(heading)
    return Along(product, weight)


def find_period(along: Float[np.ndarray, " lags"]) -> float | None:
    """Return the lag of the first peak beyond 0, None where nothing repeats.

    Args:
        along: An autocorrelation.
    """
    share = along / max(along[0], 1e-12)
    down = np.flatnonzero(share < BETWEEN)
    if not len(down):
        return None
    up = np.flatnonzero((share > AGAIN) & (np.arange(len(share)) > down[0]))
    if not len(up):
        return None
    after = np.flatnonzero((share <= AGAIN) & (np.arange(len(share)) > up[0]))
    end = after[0] if len(after) else len(share)
    peak = int(up[0] + np.argmax(share[up[0] : end]))
    if peak == len(share) - 1:
        return None
    low, high = share[peak - 1], share[peak + 1]
    return peak + 0.5 * (low - high) / (low - 2.0 * share[peak] + high)


def points_for(tree: HairTree, radius: float, least: int) -> int:
    """Return how many points strands need so that curls of a radius are round.

    Args:
        tree: The tree that strands come from.
        radius: Of their curls, in metres; 0 where they do not curl.
        least: What straight strands need. As many or a multiple come back, of which
            there are few, as each is compiled.
    """
    if radius <= 0.0:
        return least
    skeleton = np.asarray(tree.cylinder.skeleton, np.float64)[leaves(tree)]
    turns = np.quantile(along_paths(skeleton)[:, -1], 0.9) / (PITCH * radius)
    times = math.ceil(TURN_POINTS * turns / least)
    return least * max(1, min(times, MOST_POINTS // least))
