"""Where hair runs in photographs that were shaken.

A picture smeared along a line keeps no texture but streaks along that line, which every
filter follows and believes. In a smaller picture the smear is shorter than what is left
of the hair's texture is wide, and hair runs in it as it does in a large one, to half a
degree. So each photograph is looked at in two sizes. Where they disagree, fine curls
run any way about their locks; streaks all run one way.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Shaped

from .orientation import (
    SIGMA_BLIND,
    Lines,
    OrientationMap,
    bounding_box,
    estimate_orientation,
    line_angle,
    map_of_lines,
)

# Of the hair's longer side, the small picture has a third of the pixels, but so many.
SMALLER = 3.0
LEAST_SIDE, MOST_SIDE = 100, 200
LEAST_SMALLER = 1.5  # times; of less difference nothing can be told
APART = math.radians(25.0)  # lines farther apart than this disagree
# Least shares that disagree, and how far these run along one line. Of sharp pictures
# 0.02 disagrees and runs along one line to 0.89 at most, of those of curls much more,
# to 0.85 at most.
SMEARED = ((0.01, 0.92), (0.04, 0.87))
SMALL_CHANCE = 1.6  # times the expected error: a small picture has fewer pixels to tell


class Smear(NamedTuple):
    """How a photograph is smeared.

    Attributes:
        angle: Angle of its streaks, from +x towards +y (down), in radians.
        share: Of the hair whose direction it tells, how much seems to run along them.
    """

    angle: float
    share: float


class Steady(NamedTuple):
    """The orientation map of a photograph, and how it is smeared; None if it is not."""

    found: OrientationMap
    smear: Smear | None


def steady_orientation(
    image: Shaped[np.ndarray, "..."], hair: Bool[np.ndarray, "height width"]
) -> Steady:
    """Return the orientation of hair, from a smaller picture if this one is smeared.

    Args:
        image: Linear RGB, `(height, width, 3)`.
        hair: Which pixels are hair.

    Raises:
        InputError: If the sizes differ or the picture holds values that are not finite.
    """
    found, share = estimate_orientation(image, hair), share_of_small(hair)
    if share > 1.0 / LEAST_SMALLER:
        return Steady(found, None)
    smaller = smaller_orientation(image, hair, share)
    smear = find_smear(found, smaller)
    if smear is None:
        return Steady(found, None)
    least = smaller_orientation(image, hair, 0.5 * share)
    return Steady(smaller if find_smear(smaller, least) is None else least, smear)


def share_of_small(hair: Bool[np.ndarray, "height width"]) -> float:
    """Return how many pixels a side the small picture has for one of the large."""
    side = max(hair[bounding_box(hair)].shape) if hair.any() else 1
    return min(min(max(side / SMALLER, LEAST_SIDE), MOST_SIDE) / side, 1.0)


def find_smear(fine: OrientationMap, coarse: OrientationMap) -> Smear | None:
    """Return how a picture is smeared, None if it is not.

    Args:
        fine: Its orientation map.
        coarse: That of a smaller picture, at the same size.
    """
    weight = fine.confidence.astype(np.float64) * coarse.confidence
    odd = np.where(line_angle(fine.angle, coarse.angle) > APART, weight, 0.0)
    share = float(odd.sum() / max(weight.sum(), 1e-12))
    line = np.sum(odd * np.exp(2j * fine.angle))
    alike = float(np.abs(line) / max(odd.sum(), 1e-12))
    if not any(share >= least and alike >= along for least, along in SMEARED):
        return None
    return Smear(float(np.angle(line) / 2 % np.pi), share)


def smaller_orientation(
    image: Shaped[np.ndarray, "height width 3"],
    hair: Bool[np.ndarray, "height width"],
    share: float,
) -> OrientationMap:
    """Return the orientation map of a smaller picture, at the size of the large one.

    Args:
        image: Linear RGB.
        hair: Which pixels are hair.
        share: How many pixels a side the smaller picture has for one of the large.
    """
    import cv2

    full = hair.shape[::-1]
    size = (max(1, round(share * full[0])), max(1, round(share * full[1])))

    def resized(values: np.ndarray, size: tuple[int, int], way: int) -> np.ndarray:
        return cv2.resize(values.astype(np.float32), size, interpolation=way)

    small = resized(image, size, cv2.INTER_AREA)
    found = estimate_orientation(small, resized(hair, size, cv2.INTER_AREA) > 0.5)
    trust, turn = found.confidence, 2.0 * found.angle
    line = np.stack([trust * np.cos(turn), trust * np.sin(turn)], axis=2)
    line = resized(line, full, cv2.INTER_LINEAR)
    spread = SMALL_CHANCE * resized(found.sigma, full, cv2.INTER_LINEAR)
    return map_of_lines(Lines(line, np.minimum(spread, np.float32(SIGMA_BLIND))), hair)
