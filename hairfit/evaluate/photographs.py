"""Recovered strands against the photographs themselves."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..capture.orientation import OrientationMap, line_angle
from ..capture.shake import steady_orientation
from ..render.raster import Raster, rasterise_wider
from .visibility import Sight

COVER_PX = 1.0
"""How far beyond its own pixels a strand covers: recovered strands are fewer."""


@dataclasses.dataclass(frozen=True)
class PhotographErrors:
    """How strands, drawn by a photograph's camera, fit that photograph.

    Attributes:
        name: Name of the photograph.
        mean_angle_deg: Mean angle between drawn hair and the orientation map, weighted
            by its confidence; None if no confident pixel is covered.
        median_angle_deg: Median of the same, weighted alike.
        iou: Area of drawn hair and hair mask in common, over that of either.
    """

    name: str
    mean_angle_deg: float | None
    median_angle_deg: float | None
    iou: float

    def to_dict(self) -> dict[str, float | None]:
        """Return the figures without the name, ready for JSON."""
        return {
            "mean_angle_deg": self.mean_angle_deg,
            "median_angle_deg": self.median_angle_deg,
            "hair_iou": self.iou,
        }


class WeightedErrors(NamedTuple):
    """Mean and median, weighted."""

    mean: float
    median: float


class Drawn(NamedTuple):
    """Strands in a photograph: in their own pixels, and as wide as they cover."""

    thin: Raster
    wide: Raster


def draw_in(points: Float[np.ndarray, "strands knots 3"], sight: Sight) -> Drawn:
    """Return strands as a photograph would show them."""
    radii = (0.0, COVER_PX)
    return Drawn(*rasterise_wider(points, sight.view.camera, radii, sight.behind))


def compare_with_photograph(
    points: Float[np.ndarray, "strands knots 3"],
    sight: Sight,
    *,
    found: OrientationMap | None = None,
    drawn: Drawn | None = None,
) -> PhotographErrors:
    """Return how strands fit one photograph.

    Args:
        points: The strands, with equal counts of points.
        sight: The photograph.
        found: Its orientation map, if that is known already.
        drawn: The strands as `draw_in` draws them in it, if that is known already.
    """
    view = sight.view
    thin, wide = draw_in(points, sight) if drawn is None else drawn
    if found is None:
        found = steady_orientation(view.image, view.hair).found
    weight = np.where(thin.coverage & view.hair, found.confidence, 0.0)
    at = weight > 0.0
    errors = None
    if at.any():
        errors = weigh(line_angle(thin.orientation[at], found.angle[at]), weight[at])
    return PhotographErrors(
        name=view.name,
        mean_angle_deg=None if errors is None else float(np.degrees(errors.mean)),
        median_angle_deg=None if errors is None else float(np.degrees(errors.median)),
        iou=overlap(wide.coverage, view.hair),
    )


def weigh(
    values: Float[np.ndarray, " pixels"], weights: Float[np.ndarray, " pixels"]
) -> WeightedErrors:
    """Return the weighted mean and median."""
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order])
    middle = order[np.searchsorted(share, share[-1] / 2)]
    return WeightedErrors(
        float(np.average(values, weights=weights)), float(values[middle])
    )


def overlap(
    first: Bool[np.ndarray, "height width"], second: Bool[np.ndarray, "height width"]
) -> float:
    """Return the area of both over the area of either; 1 if both are empty."""
    either = int(np.sum(first | second))
    return float(np.sum(first & second)) / either if either else 1.0
