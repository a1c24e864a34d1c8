"""Points along strands at equal distances: what the scores count."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..errors import InputError
from ..types import Strands

SPACING = 1e-3
"""Distance between the counted points along a strand, in metres."""


LONGEST = 10.0
"""Median length of strands beyond which they are not in metres."""

WIDEST = 1000.0
"""Width of all hair beyond which it is not in metres, or lies astray."""


class Samples(NamedTuple):
    """Points on strands. Metres.

    Attributes:
        points: Where they lie, one strand after the other, from the root on.
        directions: Unit tangents towards the tip.
        strand: The strand of each point.
    """

    points: Float[np.ndarray, "samples 3"]
    directions: Float[np.ndarray, "samples 3"]
    strand: Int[np.ndarray, " samples"]

    def take(self, index: np.ndarray) -> "Samples":
        """Return the samples at `index` (indices or a mask)."""
        return Samples(self.points[index], self.directions[index], self.strand[index])


def sample_strands_evenly(
    strands: Strands, spacing: float = SPACING, name: str = "the strands"
) -> Samples:
    """Return points every `spacing` of arc length, from the root, without the tip.

    The direction of a point is that of the segment it lies on; at a joint that is the
    segment towards the tip.

    Args:
        strands: The strands; those without length give no points.
        spacing: Distance along the strand, in metres.
        name: What to call the strands in a message.

    Returns:
        The points.

    Raises:
        InputError: If there is no strand with a length, or a point is not finite.
    """
    points = np.asarray(strands.points, np.float64)
    offsets = np.asarray(strands.offsets, np.int64)
    if strands.count < 1 or len(points) < 2:
        raise InputError(f"{name} hold no strand; nothing can be compared.")
    if not np.isfinite(points).all():
        raise InputError(f"{name} hold points that are not finite numbers; mend them.")
    steps = np.diff(points, axis=0)
    length = np.sqrt(np.einsum("ij,ij->i", steps, steps))
    # From one strand's last point to the next one's first is no hair.
    joints = offsets[1:-1]
    length[joints[(joints > 0) & (joints < len(points))] - 1] = 0.0
    along = np.concatenate([[0.0], np.cumsum(length)])
    start = along[np.minimum(offsets[:-1], len(along) - 1)]
    total = along[np.maximum(offsets[1:] - 1, 0)] - start
    total[np.diff(offsets) < 2] = 0.0
    check_size(total, points, name)
    count = np.ceil(total / spacing - 1e-9).astype(np.int64).clip(0)
    if count.sum() == 0:
        raise InputError(f"{name} have no length; nothing can be compared.")
    strand = np.repeat(np.arange(strands.count), count)
    order = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    at = start[strand] + order * spacing
    segment = np.searchsorted(along, at, side="right") - 1
    # Rounding must not push a point into a neighbouring strand.
    segment = segment.clip(offsets[strand], offsets[strand + 1] - 2)
    segment = skip_empty(segment, length)
    direction = steps[segment] / length[segment, None]
    place = points[segment] + direction * (at - along[segment])[:, None]
    return Samples(place, direction, strand)


def check_size(
    lengths: Float[np.ndarray, " strands"],
    points: Float[np.ndarray, "points 3"],
    name: str,
) -> None:
    """Refuse what cannot be hair in metres, before it fills the memory."""
    extent = float(np.ptp(points, axis=0).max())
    if np.median(lengths) > LONGEST or extent > WIDEST:
        raise InputError(
            f"{name} are {np.median(lengths):.3g} m long in the median and "
            f"{extent:.3g} m wide in all; scale them to metres."
        )


def skip_empty(
    segment: Int[np.ndarray, " samples"], length: Float[np.ndarray, " segments"]
) -> Int[np.ndarray, " samples"]:
    """Return for each segment itself, or the last one before it that has a length."""
    index = np.where(length > 0, np.arange(len(length)), 0)
    return np.maximum.accumulate(index)[segment]
