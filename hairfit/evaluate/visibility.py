"""Which points of hair the photographs show, and which lie within."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..abreast import abreast
from ..capture.capture import View
from ..render.raster import mesh_depth, rasterise, visible_points
from ..types import Mesh, Strands
from .sample import Samples

SEE_INTO = 2e-3
"""How deep one sees into hair, in metres."""

MOST_KNOTS = 64
"""Strands of different counts of points are drawn with at most so many."""


class Sight(NamedTuple):
    """A photograph, and the depth of the head in it, which hides hair."""

    view: View
    behind: Float[np.ndarray, "height width"] | None


def look(head: Mesh | None, views: Sequence[View]) -> list[Sight]:
    """Return the photographs with the depth of the head in each."""
    if head is None:
        return [Sight(view, None) for view in views]
    depths = abreast(lambda view: mesh_depth(head, view.camera), views)
    return [Sight(*one) for one in zip(views, depths, strict=True)]


def find_visible(
    samples: Samples,
    drawn: Float[np.ndarray, "strands knots 3"],
    sights: Sequence[Sight],
) -> Bool[np.ndarray, " samples"]:
    """Return which points on strands at least one camera sees.

    A camera sees a point that is not behind the head and not farther than 2 mm and a
    pixel's footprint behind the front-most of the same strands.

    Args:
        samples: Points on the strands.
        drawn: The strands, which hide each other, with equal counts of points.
        sights: The photographs.
    """

    def seen_by(sight):
        view, behind = sight
        front = rasterise(drawn, view.camera, mesh_depth=behind).depth
        return visible_points(samples.points, view.camera, front, behind, SEE_INTO)

    seen = np.zeros(len(samples.points), bool)
    for found in abreast(seen_by, sights):
        seen |= found
    return seen


def even_strands(strands: Strands) -> Float[np.ndarray, "strands knots 3"]:
    """Return strands of equal counts of points: as they are, or resampled."""
    counts = np.diff(strands.offsets)
    if counts.min() == counts.max() > 1:
        return strands.points.reshape(strands.count, -1, 3)
    long = counts >= 2
    keep = np.repeat(long, counts)
    offsets = np.concatenate([[0], np.cumsum(counts[long])])
    longer = Strands(strands.points[keep], offsets)
    return longer.resample(int(min(counts.max(), MOST_KNOTS)))
