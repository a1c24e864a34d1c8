"""Whether hair winds about its locks or waves in planes: by how locks lean.

Of hair that winds one sees the front of each turn, which slopes to one side all along
its lock: over a turn, what one sees leans to that side, and that of a lock beside it,
which winds for itself, often to the other. Hair that waves in a plane slopes as much to
the one side as to the other, and over a wave it leans to none. That the locks' own
direction is a little wrong leans many of them alike, and does not count.
"""

import numpy as np
from jaxtyping import Bool, Float, Float32

from ..capture.filters import gaussian_blur, square_means
from ..capture.orientation import OrientationMap, bounding_box
from .repeats import LEAST
from .slopes import SUREST, TRUST

PIXEL = 0.0015  # metres of a pixel to which maps are reduced: a part of a lock
AROUND = 0.020  # standard deviation of the Gaussian in which locks lean alike, metres
FILLED = 0.5  # of such a pixel at least is hair
# And along its lock at least this share of what pixels say along others, the median.
SAYS = 0.3


def leaning(
    hair: Bool[np.ndarray, "height width"],
    found: OrientationMap,
    lines: Float[np.ndarray, "height width 2"],
    pixel: float,
    pitch: float,
) -> Float[np.ndarray, " 2"]:
    """Return how much of what hair swings about its locks leans, lock by lock.

    Args:
        hair: Which pixels are hair.
        found: The orientation map.
        lines: Cosine and sine of twice the angle of the locks, the longer the surer.
        pixel: Width of a pixel, in metres.
        pitch: Length of a turn, in metres.

    Returns:
        Two sums of squares over the hair whose locks are told best, of the sine of
        twice the angle from them: of its mean over a turn, less that of locks around,
        and of itself.
    """
    if not hair.any():
        return np.zeros(2)
    times = max(1, round(PIXEL / pixel))
    box = bounding_box(hair)
    inside = hair[box]
    lock = np.where(inside[..., None], lines[box], 0.0)
    length = np.maximum(np.hypot(lock[..., 0], lock[..., 1]), LEAST)
    twice = 2.0 * found.angle[box]
    sine = (np.sin(twice) * lock[..., 0] - np.cos(twice) * lock[..., 1]) / length
    says = np.where(inside, found.confidence[box] ** TRUST, 0.0)
    parts = np.stack([says * sine, says, lock[..., 0], lock[..., 1], inside], axis=2)
    each = square_means(parts, times)

    pixel = times * pixel
    way = 0.5 * np.arctan2(each[..., 3], each[..., 2])
    turn = means_along(each[..., :2], way, pitch / pixel)
    full = each[..., 4] > FILLED
    if not turn[full, 1].any():
        return np.zeros(2)
    told = full & (turn[..., 1] > SAYS * np.median(turn[full, 1]))
    counts = np.where(told, turn[..., 1], 0.0)
    lean = turn[..., 0] / np.maximum(turn[..., 1], LEAST)
    around = gaussian_blur(np.stack([counts * lean, counts], axis=2), AROUND / pixel)
    lean = lean - around[..., 0] / np.maximum(around[..., 1], LEAST)
    sure = np.hypot(each[..., 2], each[..., 3])
    best = told & (sure >= np.quantile(sure[told], 1.0 - SUREST))
    swings = each[best, 0] ** 2 / np.maximum(each[best, 1], LEAST)
    return np.array([np.sum(counts[best] * lean[best] ** 2), np.sum(swings)], float)


def means_along(
    values: Float32[np.ndarray, "rows columns channels"],
    way: Float32[np.ndarray, "rows columns"],
    length: float,
) -> Float32[np.ndarray, "rows columns channels"]:
    """Return means along straight lines about each pixel; beyond the border all is 0.

    Args:
        values: What is averaged.
        way: The lines' angle, from +x towards +y.
        length: How long they are, in pixels.
    """
    import cv2

    row, column = np.indices(way.shape, dtype=np.float32)
    count = max(1, round(length))
    total = np.zeros_like(values)
    for step in (np.arange(count) - 0.5 * (count - 1)) * (length / count):
        x, y = (
            (at + step * part(way)).astype(np.float32)
            for at, part in ((column, np.cos), (row, np.sin))
        )
        total += cv2.remap(values, x, y, cv2.INTER_LINEAR)
    return total / np.float32(count)
