"""Curls in photographs: how long a turn is, and which way their locks run.

Where hair curls, what a pixel shows is the side of a turn, not the lock. Over the area
of a turn the angles average to the lock's own direction. Along the lock they swing
about it and repeat after a turn: the first peak of their autocorrelation is the pitch.
Hair that swings little, or repeats nowhere, is taken as it looks.

The phases of curls and their handedness are not recovered: neighbours hide one another,
and photographs from far apart see other locks. Nor is their slope, of which maps show
half; a pitch gives the radius as it does for the curls of single hairs, see `fur`.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from ..capture.capture import View
from ..capture.orientation import SIGMA_BLIND, OrientationMap
from ..model.fur import PITCH
from ..model.tree import HairTree, leaves
from ..render.raster import project_points
from ..types import along_paths
from .hull import Hull

# Standard deviation of the Gaussian over which angles are averaged, in metres: half of
# a turn of the curls that can be seen.
LOCK = 0.016
# What curls swing about their locks at least: the mean square of the sine of twice the
# angle. Drawn curls have 0.30, waves 0.07, all that is straight or tied 0.05 at most;
# waves are nearer to their mean direction than to waves of another phase.
LEAST_SWING = 0.15
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


class Swing(NamedTuple):
    """What angles do along locks, summed over places with weights.

    Attributes:
        product: Of the sines of twice the angle to the lock, for each lag in steps.
        weight: Of the pairs of places at each lag.
    """

    product: Float[np.ndarray, " lags"]
    weight: Float[np.ndarray, " lags"]


def find_curls(
    hull: Hull, views: Sequence[View], maps: Sequence[OrientationMap]
) -> float:
    """Return the radius of the hair's curls in metres, 0 where none are seen.

    Args:
        hull: Where hair can be, which says how large a pixel is.
        views: The photographs.
        maps: Their orientation maps.
    """
    some = range(0, len(views), -(-len(views) // MOST_VIEWS))
    locks = [lock_directions(hull, views[k], maps[k]) for k in some]
    square = total = 0.0
    for k, lock in zip(some, locks, strict=True):
        swing = np.sin(2.0 * (maps[k].angle - lock.angle))
        square += float((maps[k].confidence * swing**2).sum())
        total += float(maps[k].confidence.sum())
    if square < LEAST_SWING * total or total == 0.0:
        return 0.0
    along = [
        follow_locks(views[k].hair, maps[k], lock, pixel_size(hull, views[k]))
        for k, lock in zip(some, locks, strict=True)
    ]
    product, weight = (np.sum(sums, axis=0) for sums in zip(*along, strict=True))
    many = weight > FEW * weight[0]
    pitch = find_period(np.where(many, product / np.maximum(weight, 1e-12), 0.0))
    return 0.0 if pitch is None else STEP * pitch / PITCH


def lock_directions(hull: Hull, view: View, found: OrientationMap) -> OrientationMap:
    """Return the map of the locks' directions: what curls swing about.

    Every pixel of hair that says anything counts alike, as one side of a turn is seen
    sharper than the other. How far they disagree is the error to expect.

    Args:
        hull: Where hair can be, which says how large a pixel is.
        view: The photograph.
        found: Its orientation map.
    """
    blur = LOCK / pixel_size(hull, view)
    says = (view.hair & (found.confidence > 0.0)).astype(np.float32)
    cosine, sine, count = (
        ndimage.gaussian_filter(says * part, blur, truncate=3.0)
        for part in (np.cos(2.0 * found.angle), np.sin(2.0 * found.angle), 1.0)
    )
    angle = np.mod(np.arctan2(sine, cosine) / 2.0, np.pi)
    agree = np.hypot(cosine, sine) / np.maximum(count, 1e-6)
    spread = np.sqrt(-2.0 * np.log(np.clip(agree, 1e-3, 1.0))) / 2.0
    sigma = np.where(view.hair, np.minimum(spread, SIGMA_BLIND), SIGMA_BLIND)
    return OrientationMap(
        angle.astype(np.float32),
        np.where(view.hair, agree, 0.0).astype(np.float32),
        sigma.astype(np.float32),
    )


def pixel_size(hull: Hull, view: View) -> float:
    """Return how wide a pixel is at the middle of the hair, in metres."""
    middle = hull.grid.centres(hull.hair).mean(axis=0, keepdims=True)
    depth = float(project_points(middle, view.camera).depth[0])
    return depth / float(view.camera.K[0, 0])


def follow_locks(
    hair: Bool[np.ndarray, "height width"],
    found: OrientationMap,
    lock: OrientationMap,
    pixel: float,
) -> Swing:
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
        return Swing(product, weight)
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
        swing = np.sin(2.0 * (found.angle[y, x] - heading))
        sure = found.confidence[y, x] * goes
        if not lag:
            first, start = swing, sure
        product[lag] = (start * sure * first * swing).sum()
        weight[lag] = (start * sure).sum()
        row = row + STEP / pixel * np.sin(heading)
        column = column + STEP / pixel * np.cos(heading)
    return Swing(product, weight)


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
