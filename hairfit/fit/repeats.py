"""How curls repeat in a photograph: after what length, and along which way.

Of each turn of a curl one sees the front, which slopes to one side for curls that wind
to the right and to the other for those that wind to the left: a mean over few locks
leans to either side. But a lock repeats itself after a turn, and its neighbours, which
wind for themselves, do not repeat it. So the angles about a place go most with those a
turn away along the lock.

Where all hair about a place lies nearly alike it runs along its lock, whatever repeats
across it: waves of locks beside each other do, where many go together.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32
from scipy import ndimage, signal

from ..capture.filters import gaussian_blur, square_means
from ..capture.orientation import OrientationMap, bounding_box
from .slopes import TRUST

PIXEL = 0.003  # metres of a pixel to which maps are reduced
MEAN = 0.012  # standard deviation of the Gaussian about whose mean angles swing, metres
AROUND = 0.030  # and of that in which turns repeat
WAYS = np.pi * np.arange(16) / 16  # that are compared: angles from +x towards +y
# Shares of a turn after which it repeats in the picture: locks that lean towards the
# camera are seen shorter.
TURNS = (0.7, 0.8, 0.9, 1.0, 1.1)
# A way whose correlation is so much less than the best one's counts an e-th of it.
SHARP = 0.15
# Lengths of a turn that are tried, in metres; 0 tells all.
LAGS = np.arange(41) * 0.0025
NEAR = 0.016  # metres; nearer than this all goes together, and tells no way
# How far the correlation rises to the peak of a turn, and falls after it.
PROMINENT = 0.1
LEAST = 1e-3  # of a mean's weight, below which it says nothing
# Hair lies alike where the cosine of twice its angle from the mean has this mean.
ALIKE = 0.95


class Swings(NamedTuple):
    """How lines swing about their mean, in larger pixels.

    Attributes:
        line: Cosine and sine of twice their angle, less those of the mean, weighted by
            what the pixel says.
        mean: Those of the mean, 1 long where all lines about the pixel are alike.
        pixel: Width of a pixel, in metres.
        times: How many pixels of the map that is.
        box: Which part of the map it is: where the hair is.
    """

    line: Float32[np.ndarray, "rows columns 2"]
    mean: Float32[np.ndarray, "rows columns 2"]
    pixel: float
    times: int
    box: tuple[slice, slice]


def find_swings(
    hair: Bool[np.ndarray, "height width"], found: OrientationMap, pixel: float
) -> Swings:
    """Return how the lines of an orientation map swing about their mean.

    Args:
        hair: Which pixels are hair.
        found: The orientation map.
        pixel: Width of a pixel, in metres.
    """
    times = max(1, round(PIXEL / pixel))
    box = bounding_box(hair) if hair.any() else (slice(None), slice(None))
    says = np.where(hair[box], found.confidence[box] ** TRUST, 0.0)
    twice = 2.0 * found.angle[box]
    each = np.stack([says * np.cos(twice), says * np.sin(twice), says], axis=2)
    each = square_means(each, times)
    mean = gaussian_blur(each, MEAN / (times * pixel))
    mean = mean[..., :2] / np.maximum(mean[..., 2:], LEAST)
    line = each[..., :2] - each[..., 2:] * mean
    return Swings(line, mean, times * pixel, times, box)


def possible(swings: Swings) -> Bool[np.ndarray, "ways rows columns"]:
    """Return along which of `WAYS` locks may run: not across hair that lies alike.

    Args:
        swings: How lines swing.
    """
    along = np.einsum("wk,rck->wrc", doubled(WAYS), swings.mean)
    return ~alike(swings) | (along >= 0.0)


def alike(swings: Swings) -> Bool[np.ndarray, "rows columns"]:
    """Return where lines lie alike.

    Args:
        swings: How they swing.
    """
    return np.linalg.norm(swings.mean, axis=2) >= ALIKE


def doubled(angle: Float[np.ndarray, " lines"]) -> Float[np.ndarray, "lines 2"]:
    """Return cosine and sine of twice the angles of lines."""
    return np.stack([np.cos(2.0 * angle), np.sin(2.0 * angle)], axis=1)


def correlation(
    swings: Swings, way: float, lag: float
) -> Float32[np.ndarray, "rows columns"]:
    """Return how swings at both ends of a step go together, summed about its middle.

    Beyond the border nothing swings: few pairs, as there are of long steps, say little.

    Args:
        swings: How lines swing.
        way: Angle of the step, from +x towards +y.
        lag: Its length, in metres.
    """
    steps = lag / swings.pixel
    row, column = round(steps * np.sin(way)), round(steps * np.cos(way))
    ahead = shifted(swings.line, row // 2, column // 2)
    behind = shifted(swings.line, row // 2 - row, column // 2 - column)
    return gaussian_blur((ahead * behind).sum(axis=2), AROUND / swings.pixel)


def shifted(
    values: Float32[np.ndarray, "rows columns channels"], row: int, column: int
) -> Float32[np.ndarray, "rows columns channels"]:
    """Return what lies so many pixels farther at each pixel, 0 beyond the border."""
    out = np.zeros_like(values)
    rows, columns = values.shape[:2]
    end = max(rows + row, 0), max(columns + column, 0)
    target = values[max(row, 0) : end[0], max(column, 0) : end[1]]
    at = max(-row, 0), max(-column, 0)
    out[at[0] : at[0] + target.shape[0], at[1] : at[1] + target.shape[1]] = target
    return out


def repeating_lines(
    hair: Bool[np.ndarray, "height width"],
    found: OrientationMap,
    pixel: float,
    pitch: float,
) -> Float[np.ndarray, "height width 2"]:
    """Return along which way turns repeat: cosine and sine of twice its angle.

    Their length is from 0, where all ways are alike, to 1, where one is best by far.

    Args:
        hair: Which pixels are hair.
        found: The orientation map.
        pixel: Width of a pixel, in metres.
        pitch: Length of a turn, in metres.
    """
    swings = find_swings(hair, found, pixel)
    power = correlation(swings, 0.0, 0.0)
    lags = [share * pitch for share in TURNS]
    go = np.stack(
        [
            np.max([correlation(swings, way, lag) for lag in lags], axis=0)
            for way in WAYS
        ]
    )
    go = go / np.maximum(power, LEAST)
    line = best_line(go)
    along = best_line(np.where(possible(swings), go, -np.inf))
    across = alike(swings) & ((line * swings.mean).sum(axis=2) < 0.0)
    # No surer than it was, as fewer ways look surer.
    longest = np.linalg.norm(line[across], axis=1, keepdims=True)
    length = np.linalg.norm(along[across], axis=1, keepdims=True)
    line[across] = along[across] * np.minimum(longest / np.maximum(length, LEAST), 1.0)
    line = line.repeat(swings.times, axis=0).repeat(swings.times, axis=1)
    whole = np.zeros((*hair.shape, 2))
    rows, columns = whole[swings.box].shape[:2]
    whole[swings.box] = line[:rows, :columns]
    return whole


def best_line(
    go: Float[np.ndarray, "ways rows columns"],
) -> Float[np.ndarray, "rows columns 2"]:
    """Return cosine and sine of twice the angle of the way along which turns repeat.

    Args:
        go: How swings go together along each of `WAYS`; of one at least it is finite.
    """
    share = np.exp((go - go.max(axis=0)) / SHARP)
    return np.einsum("wrc,wk->rck", share / share.sum(axis=0), doubled(WAYS))


def repeats(
    hair: Bool[np.ndarray, "height width"], found: OrientationMap, pixel: float
) -> Float[np.ndarray, " lags"]:
    """Return how swings go with those at each of `LAGS` along the best way, summed.

    Args:
        hair: Which pixels are hair.
        found: The orientation map.
        pixel: Width of a pixel, in metres.
    """
    swings = find_swings(hair, found, pixel)
    go = np.stack([[correlation(swings, way, lag) for lag in LAGS] for way in WAYS])
    reach = go[:, LAGS >= NEAR].max(axis=1)
    best = np.where(possible(swings), reach, -np.inf).argmax(axis=0)
    along = np.take_along_axis(go, best[None, None], axis=0)[0]
    return along.sum(axis=(1, 2), dtype=np.float64)


def find_pitch(sums: Sequence[Float[np.ndarray, " lags"]]) -> float | None:
    """Return the length of a turn in metres, None where nothing repeats.

    It is at the first peak that stands out on both sides.

    Args:
        sums: How swings in some photographs go with those at each of `LAGS`.
    """
    go = np.sum(sums, axis=0)
    # Steps of whole pixels make the sums jagged.
    go = ndimage.gaussian_filter1d(go / max(float(go[0]), 1e-12), 1.0)
    peaks, _ = signal.find_peaks(go, prominence=PROMINENT)
    if not len(peaks):
        return None
    low, high, higher = go[peaks[0] - 1 : peaks[0] + 2]
    off = 0.5 * (low - higher) / (low - 2.0 * high + higher)
    return float(LAGS[peaks[0]] + off * (LAGS[1] - LAGS[0]))
