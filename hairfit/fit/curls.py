"""Curls in photographs: how long a turn is, and which way their locks run.

Where hair curls, what a pixel shows is the side of a turn, not the lock. Over the area
of a turn the angles average to the lock's own direction. Along the lock they swing
about it and repeat after a turn: the first peak of their autocorrelation is the pitch.

Of curls that are finer, or steeper than 45 degrees, a map shows one side of every turn,
and looks as if hair ran across its locks. Photographs from other sides then contradict
it: no line in space is seen so by three. Such hair is taken to curl at no known pitch,
and its maps to say nothing of its locks. All other hair is taken as it looks.

The phases of curls and their handedness are not recovered: neighbours hide one another,
and photographs from far apart see other locks. Nor is their slope, of which maps show
half; a pitch gives the radius as it does for the curls of single hairs, see `fur`.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from ..capture.capture import View
from ..capture.orientation import (
    SIGMA_BLIND,
    SIGMA_SURE,
    OrientationMap,
    estimate_orientation,
)
from ..model.fur import PITCH
from ..model.tree import HairTree, leaves
from ..render.raster import project_points
from ..types import along_paths
from .consistency import disagreement
from .hull import Hull

# Standard deviation of the Gaussian over which angles are averaged, in metres: half of
# a turn of the curls that can be seen.
LOCK = 0.016
# What curls swing about their locks at least: the mean square of the sine of twice the
# angle. Drawn curls have 0.30, waves 0.07, all that is straight or tied 0.05 at most;
# waves are nearer to their mean direction than to waves of another phase.
LEAST_SWING = 0.15
# Maps that are surer are not asked whether they contradict each other.
SURE = 0.2
# The median error of locks about one line at which they do, in radians: drawn afros and
# ringlets have 10 degrees, all else 4 at most, but with much noise up to 10 as well.
CONTRADICTION = math.radians(7.0)
LEAST_SAYING = 0.75  # share of the hair's pixels that must say something
LEAST_KNOWN = 0.05  # and of its voxels that three photographs must see
# Smoothed by a Gaussian of so many pixels, noisy photographs of straight hair are three
# to four times as sure, those of afros and ringlets no surer.
GRAIN, SURER = 2.5, 1.7
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
    depths: Sequence[Float[np.ndarray, "_height _width"]],
) -> Curls:
    """Return how curly the photographed hair is, and which way its locks run.

    Args:
        hull: Where hair can be.
        views: The photographs.
        maps: Their orientation maps.
        depths: Depth of the head in each photograph, in metres.
    """
    straight = Curls(0.0, list(maps), True)
    pixels = pixel_sizes(hull, views)

    @functools.cache
    def lock(k: int) -> OrientationMap:
        return lock_directions(views[k].hair, maps[k], pixels[k])

    few = range(0, len(views), -(-len(views) // MOST_VIEWS))
    swings = swing([maps[k] for k in few], [lock(k) for k in few]) > LEAST_SWING
    if not swings and mean_confidence(views, maps) > SURE:
        return straight
    locks = [lock(k) for k in range(len(views))]
    if swings:
        radius = find_radius(
            [follow_locks(views[k].hair, maps[k], locks[k], pixels[k]) for k in few]
        )
        if radius > 0.0:
            return Curls(radius, locks, True)
    seen = [views[k] for k in few], [maps[k] for k in few]
    if contradict(hull, views, maps, locks, depths) and not noisy(*seen):
        mute = [dataclasses.replace(m, confidence=0.0 * m.confidence) for m in maps]
        return Curls(UNSEEN, mute, False)
    return straight


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


def noisy(views: Sequence[View], maps: Sequence[OrientationMap]) -> bool:
    """Return whether it is noise that makes maps unsure, which goes when smoothed.

    Curls too fine to be seen become no clearer in a smoother photograph.

    Args:
        views: The photographs.
        maps: Their orientation maps.
    """
    smooth = [
        estimate_orientation(
            ndimage.gaussian_filter(v.image, (GRAIN, GRAIN, 0)), v.hair
        )
        for v in views
    ]
    return mean_confidence(views, smooth) > SURER * mean_confidence(views, maps)


def contradict(
    hull: Hull,
    views: Sequence[View],
    maps: Sequence[OrientationMap],
    locks: Sequence[OrientationMap],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
) -> bool:
    """Return whether photographs contradict each other about the locks' directions.

    Noise hardly does: over the area of a lock it averages out, unless few pixels say
    anything; see also `noisy`. Where no place is seen by three, nothing contradicts.

    Args:
        hull: Where hair can be.
        views: The photographs.
        maps: Their orientation maps.
        locks: Maps of the locks' directions.
        depths: Depth of the head in each photograph, in metres.
    """
    says = [v.hair & (m.confidence > 0.0) for v, m in zip(views, maps, strict=True)]
    pixels = sum(int(view.hair.sum()) for view in views)
    if sum(int(one.sum()) for one in says) < LEAST_SAYING * pixels:
        return False
    alike = [
        dataclasses.replace(m, confidence=one.astype(m.confidence.dtype))
        for m, one in zip(locks, says, strict=True)
    ]
    apart = disagreement(hull, views, alike, depths)
    known = apart[apart > 0.0]
    if len(known) < LEAST_KNOWN * hull.hair.sum():
        return False
    # In units of the error of a map that is sure.
    return bool(np.sqrt(np.median(known)) * SIGMA_SURE > CONTRADICTION)


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


def pixel_sizes(hull: Hull, views: Sequence[View]) -> list[float]:
    """Return how wide a pixel of each view is at the middle of the hair, in metres."""
    middle = hull.grid.centres(hull.hair).mean(axis=0, keepdims=True)
    return [
        float(project_points(middle, view.camera).depth[0]) / float(view.camera.K[0, 0])
        for view in views
    ]


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
