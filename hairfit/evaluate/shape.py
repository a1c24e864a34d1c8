"""Whether strands are as long and as curved as the true ones."""

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from ..types import Strands
from .sample import sample_strands_evenly

CURVATURE_SPACING = 5e-3
"""Curvature is taken from points so far apart: nearer ones measure noise. Metres."""

QUANTILES = (np.arange(200) + 0.5) / 200


@dataclasses.dataclass(frozen=True)
class ShapeErrors:
    """Errors of lengths in metres and of curvatures in 1/metre, recovered minus true.

    Attributes:
        median_length: Relative error of the median length.
        length: Mean absolute difference of lengths at equal quantiles.
        length_at_root: Mean absolute difference between the lengths of a true strand
            and of the recovered one that is rooted nearest to it.
        median_curvature: Difference of the median curvatures.
        curvature: Mean absolute difference of curvatures at equal quantiles. Both are
            None if one of the hairs is too short to have a curvature.
    """

    median_length: float
    length: float
    length_at_root: float
    median_curvature: float | None
    curvature: float | None


def compare_shapes(pred: Strands, truth: Strands) -> ShapeErrors:
    """Return how lengths and curvatures of recovered and true strands differ."""
    found, true = strand_lengths(pred), strand_lengths(truth)
    median = float(np.median(true))
    nearest = KDTree(roots(pred)).query(roots(truth))[1]
    bent, truly_bent = curvatures(pred), curvatures(truth)
    known = len(bent) > 0 and len(truly_bent) > 0
    return ShapeErrors(
        median_length=float(np.median(found)) / median - 1.0 if median else 0.0,
        length=quantile_distance(found, true),
        length_at_root=float(np.mean(np.abs(found[nearest] - true))),
        median_curvature=(
            float(np.median(bent) - np.median(truly_bent)) if known else None
        ),
        curvature=quantile_distance(bent, truly_bent) if known else None,
    )


def strand_lengths(strands: Strands) -> Float[np.ndarray, " strands"]:
    """Return the length of every strand, in metres."""
    points = strands.points.astype(np.float64)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    return along[strands.offsets[1:] - 1] - along[strands.offsets[:-1]]


def roots(strands: Strands) -> Float[np.ndarray, "strands 3"]:
    """Return the first point of every strand."""
    return strands.points[strands.offsets[:-1]].astype(np.float64)


def curvatures(strands: Strands) -> Float[np.ndarray, " triples"]:
    """Return the curvatures of strands, in 1/metre.

    A curvature is that of the circle through three neighbouring points.
    """
    if strand_lengths(strands).max() <= 2 * CURVATURE_SPACING:
        return np.zeros(0)
    points, _, strand = sample_strands_evenly(strands, CURVATURE_SPACING)
    same = strand[2:] == strand[:-2]
    first = (points[1:-1] - points[:-2])[same]
    second = (points[2:] - points[1:-1])[same]
    area = np.linalg.norm(np.cross(first, second), axis=1)
    sides = np.prod([np.linalg.norm(x, axis=1) for x in (first, second)], axis=0)
    third = np.linalg.norm(first + second, axis=1)
    return 2.0 * area / np.maximum(sides * third, 1e-15)


def quantile_distance(
    found: Float[np.ndarray, " found"], true: Float[np.ndarray, " true"]
) -> float:
    """Return the mean absolute difference of two distributions at equal quantiles."""
    gap = np.quantile(found, QUANTILES) - np.quantile(true, QUANTILES)
    return float(np.mean(np.abs(gap)))
