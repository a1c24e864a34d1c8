"""Opacity and light at points in hair, from maps, layers or exact lists [Kim02, 6.2.1].

Depth is compared in each texel before texels are averaged: opacity may be filtered,
depth may not.
"""

from collections.abc import Iterator
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .opacity_exact import ExactLists
from .opacity_layers import LayeredMaps
from .opacity_maps import OpacityMaps
from .opacity_occupied import OccupiedMaps
from .view import see_all

Filter = Literal["nearest", "bilinear", "box3"]


class Tap(NamedTuple):
    """One texel that each point looks up, and what it weighs.

    Attributes:
        row: Row of the texel.
        column: Its column.
        weight: From 0 to 1; a point's weights sum to 1.
    """

    row: Int[np.ndarray, " points"]
    column: Int[np.ndarray, " points"]
    weight: Float[np.ndarray, " points"]


class AxisTaps(NamedTuple):
    """Rows or columns that points look up, and their weights.

    Attributes:
        index: Of the row or column, not clamped.
        weight: From 0 to 1.
    """

    index: Int[np.ndarray, "taps points"]
    weight: Float[np.ndarray, "taps points"]


def opacity_at(
    maps: OpacityMaps | LayeredMaps | OccupiedMaps | ExactLists,
    points: Float[np.ndarray, "*points 3"],
    *,
    filter: Filter = "bilinear",
    interpolation: Literal["linear", "cubic"] = "linear",
) -> Float[np.ndarray, "*points"]:
    r"""Return the opacity $\Omega$ between a light and points (lines 13 to 15).

    Args:
        maps: What the light sees.
        points: Points of the world, in metres. Those that the view does not see are
            lit; beside the picture its border holds.
        filter: How texels are averaged: none, 2x2, or the thesis's 3x3, which here
            moves smoothly with the point.
        interpolation: Between the depths of opacity maps; "cubic" needs `OpacityMaps`.

    Raises:
        ValueError: If "cubic" is asked of anything but `OpacityMaps`.
    """
    find = maps.in_texels
    if interpolation == "cubic":
        if not isinstance(maps, OpacityMaps):
            raise ValueError(
                f"cubic interpolation needs `OpacityMaps`, got {type(maps).__name__}; "
                'use "linear".'
            )
        find = maps.in_texels_cubic
    seen = see_all(points.reshape(-1, 3), maps.view)
    total = np.zeros(len(seen))
    size = maps.view.width, maps.view.height
    for row, column, weight in taps(seen[:, :2], size, filter):
        total += weight * find(row, column, seen[:, 2])
    return np.where(seen[:, 3] > 0.0, total, 0.0).reshape(points.shape[:-1])


def transmittance(
    opacity: Float[np.ndarray, "*points"], kappa: float = 1.0
) -> Float[np.ndarray, "*points"]:
    r"""Return the share of light left, $\tau = e^{-\kappa\Omega}$ (line 16)."""
    return np.exp(-kappa * opacity)


def kappa_of_bits(bits: int) -> float:
    r"""Return the $\kappa$ with which $\Omega = 1$ is opaque to so many bits.

    $e^{-\kappa} = 2^{-d}$: 5.545 for 8 bits (the thesis rounds it to 5.56).
    """
    return bits * float(np.log(2.0))


def taps(
    pixel: Float[np.ndarray, "points 2"], size: tuple[int, int], filter: Filter
) -> Iterator[Tap]:
    """Yield the texels that points look up, one for each point at a time.

    Args:
        pixel: Where points land, in pixels, first centre at (0.5, 0.5).
        size: Width and height; texels beyond are those at the border.
        filter: How texels are averaged.
    """
    # Far beside the picture an integer could overflow.
    near = np.clip(pixel, -4.0, np.array(size) + 4.0)
    columns, rows = axis_taps(near[:, 0], filter), axis_taps(near[:, 1], filter)
    for row, of_row in zip(*rows, strict=True):
        for column, of_column in zip(*columns, strict=True):
            yield Tap(
                np.clip(row, 0, size[1] - 1),
                np.clip(column, 0, size[0] - 1),
                of_row * of_column,
            )


def axis_taps(x: Float[np.ndarray, " points"], filter: Filter) -> AxisTaps:
    """Return the rows or columns that points look up, and what they weigh."""
    if filter == "nearest":
        return AxisTaps(np.floor(x).astype(np.int64)[None], np.ones((1, len(x))))
    first = np.floor(x - 0.5)
    f = x - 0.5 - first
    if filter == "bilinear":
        reach, weight = np.arange(2), np.stack([1.0 - f, f])
    else:
        one = np.ones_like(f)
        reach, weight = np.arange(-1, 3), np.stack([1.0 - f, one, one, f]) / 3.0
    return AxisTaps(first.astype(np.int64) + reach[:, None], weight)
