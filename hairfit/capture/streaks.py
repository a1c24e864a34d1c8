"""How far streaks run in a photograph: no farther than hair is long.

Along the directions that a photograph shows, what is bright or dark goes on as one
streak for as long as hair lies beside the same hair. Where all of it is shorn, streaks
end after some millimetres, wherever they begin. How alike a picture is at two places so
far apart along a streak tells both, each by its mean over some hair.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Shaped

from .filters import gaussian_blur, mean_of_hair

# How far apart both places are, in metres: where all streaks go on, and where those of
# shorn hair have ended.
NEAR, FAR = 0.003, 0.012
# Streaks wider than the one and finer than the other, in metres, count.
FINEST, WIDEST = 0.0006, 0.004
EVEN = 0.012  # metres around over which they are as strong as elsewhere
GAP = 0.003  # metres between hairs that are still hair
AROUND = 0.003  # metres over which products are averaged
PIXEL = 0.0005  # metres: finer pictures are reduced
COARSEST = 0.0012  # metres: coarser ones do not show both places
STEP = 2  # pixels between the places at which streaks begin
FAINTEST = 0.01  # a step of brightness, as a logarithm and of white, that is none


class Streaks(NamedTuple):
    """Means over a little hair of what a picture has at two places along a streak.

    Attributes:
        near: Products of what is brighter or darker than around, close to each other.
        far: The same, far from each other.
        count: Share of the places from which streaks could be followed so far.
    """

    near: Float32[np.ndarray, "rows columns"]
    far: Float32[np.ndarray, "rows columns"]
    count: Float32[np.ndarray, "rows columns"]


def find_streaks(
    image: Shaped[np.ndarray, "height width 3"],
    hair: Bool[np.ndarray, "height width"],
    angle: Float[np.ndarray, "height width"],
    pixel: float,
) -> Streaks | None:
    """Return how far streaks run; None for a picture too coarse to tell.

    Args:
        image: Linear RGB.
        hair: Which pixels are hair.
        angle: Which way it runs, from +x towards +y (down), in radians.
        pixel: Width of a pixel at the hair, in metres.

    Returns:
        What is found, in as many rows and columns or fewer.
    """
    import cv2

    if pixel > COARSEST:
        return None
    times = min(1.0, pixel / PIXEL)
    size = tuple(max(1, round(times * side)) for side in hair.shape[::-1])
    pixel /= times
    bright = image.mean(axis=2, dtype=np.float32)
    bright = cv2.resize(bright, size, interpolation=cv2.INTER_AREA)
    angle = cv2.resize(angle.astype(np.float32), size, interpolation=cv2.INTER_NEAREST)
    some = cv2.resize(hair.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    # At gaps between hairs streaks would end.
    disk = cv2.getStructuringElement(
        cv2.MORPH_ELLIPSE, (2 * round(GAP / pixel) + 1,) * 2
    )
    hair = cv2.morphologyEx(some, cv2.MORPH_CLOSE, disk) > 0
    texture = _texture(np.log(bright + FAINTEST), hair, pixel)
    rows, columns = np.nonzero(hair)
    few = (rows % STEP == 0) & (columns % STEP == 0)
    start = rows[few], columns[few]
    near, far, count = (np.zeros(hair.shape, np.float32) for _ in range(3))
    for sense in (1.0, -1.0):
        places = _follow(hair, angle, start, sense, (NEAR / pixel, FAR / pixel))
        # Half of each, as streaks are followed both ways.
        here = 0.5 * texture[start] * places.reached
        near[start] += here * texture[places.near]
        far[start] += here * texture[places.far]
        count[start] += 0.5 * places.reached
    sums, blur = (near, far, count), AROUND / pixel
    return Streaks(*(STEP**2 * gaussian_blur(one, blur) for one in sums))


class _Places(NamedTuple):
    """Pixels that streaks reach, row and column, and which streaks reach both."""

    near: tuple[Int[np.ndarray, " streaks"], Int[np.ndarray, " streaks"]]
    far: tuple[Int[np.ndarray, " streaks"], Int[np.ndarray, " streaks"]]
    reached: Bool[np.ndarray, " streaks"]


def _follow(
    hair: Bool[np.ndarray, "rows columns"],
    angle: Float32[np.ndarray, "rows columns"],
    start: tuple[Int[np.ndarray, " streaks"], Int[np.ndarray, " streaks"]],
    sense: float,
    lags: tuple[float, float],
) -> _Places:
    """Return where streaks get to, pixel by pixel, before they leave the hair.

    Args:
        hair: Which pixels are hair.
        angle: Which way it runs, in radians.
        start: Row and column of the pixels where they begin.
        sense: Either way along it, 1 or -1.
        lags: How far they are followed, in pixels.
    """
    line = np.stack([np.sin(angle), np.cos(angle)])
    place = np.stack(start).astype(np.float32)
    at, ahead = start, np.float32(sense) * line[:, *start]
    reached = np.ones(len(place[0]), bool)
    last = np.array(hair.shape)[:, None] - 1
    found = []
    steps = [round(lag) for lag in lags]
    for step in range(1, steps[1] + 1):
        onwards = line[:, *at]
        ahead = np.where((onwards * ahead).sum(axis=0) < 0.0, -onwards, onwards)
        place += ahead
        at = tuple(np.clip(np.rint(place).astype(int), 0, last))
        reached &= hair[at]
        if step in steps:
            found.append(at)
    return _Places(found[0], found[-1], reached)


def _texture(
    values: Float32[np.ndarray, "rows columns"],
    hair: Bool[np.ndarray, "rows columns"],
    pixel: float,
) -> Float32[np.ndarray, "rows columns"]:
    """Return what is brighter or darker than around, as strong everywhere, 0 outside.

    Args:
        values: Logarithms of brightness.
        hair: Which pixels are hair.
        pixel: Width of a pixel, in metres.
    """
    fine = mean_of_hair(values, hair, max(FINEST / pixel, 0.6))
    band = np.where(hair, fine - mean_of_hair(values, hair, WIDEST / pixel), 0.0)
    strength = np.sqrt(mean_of_hair(band**2, hair, EVEN / pixel))
    return (band / (strength + FAINTEST)).astype(np.float32)
