"""Everything that is measured of recovered hair, in one go."""

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool

from ..abreast import abreast
from ..capture.capture import View
from ..host import one_blas_thread
from ..types import Mesh, Strands
from .consistency import strand_consistency
from .coverage import Coverage, fit_width
from .curls import CurlErrors, compare_curls
from .inside import HeadErrors, compare_with_head
from .match import THRESHOLDS, Matches, Rates, Score, find_matches, summarise
from .photographs import PhotographErrors, compare_with_photograph
from .sample import sample_strands_evenly
from .shape import ShapeErrors, compare_shapes
from .visibility import even_strands, find_visible, look


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """How recovered strands compare with true ones. `docs/evaluation.md` explains all.

    Attributes:
        every: Scores over all points.
        visible: Scores over those that a camera sees; None without photographs.
        interior: Scores over those that none sees; None without photographs.
        consistency: Strand consistency at each threshold.
        shape: Errors of lengths and curvatures.
        curls: Waves and curls of both.
        head: How strands meet the head; None without a head.
        photographs: How strands fit each photograph; None without photographs.
        coverage: How strands as wide as fits best cover each; None without them.
    """

    every: tuple[Score, ...]
    visible: tuple[Score, ...] | None
    interior: tuple[Score, ...] | None
    consistency: tuple[float, ...]
    shape: ShapeErrors
    curls: CurlErrors
    head: HeadErrors | None
    photographs: tuple[PhotographErrors, ...] | None
    coverage: Coverage | None

    def to_dict(self) -> dict[str, Any]:
        """Return all figures, ready for JSON: shares in [0, 1], metres, degrees."""
        names = [name_threshold(score) for score in self.every]
        figures: dict[str, Any] = {
            part: None if scores is None else scores_dict(scores)
            for part, scores in (
                ("all", self.every),
                ("visible", self.visible),
                ("interior", self.interior),
            )
        }
        figures["consistency"] = dict(zip(names, self.consistency, strict=True))
        shape = self.shape
        figures["shape"] = {
            "median_length_relative": shape.median_length,
            "length_m": shape.length,
            "length_at_root_m": shape.length_at_root,
            "median_curvature_per_m": shape.median_curvature,
            "curvature_per_m": shape.curvature,
        }
        figures["curls"] = curls_dict(self.curls)
        figures["head"] = self.head and {
            "share_inside": self.head.share_inside,
            "points_deeper_than_1mm": self.head.deep,
            "deepest_m": self.head.deepest,
            "share_rooted": self.head.rooted,
        }
        figures["strand_width_m"] = self.coverage and self.coverage.width
        figures["photographs"] = self.photographs and {
            photo.name: photo.to_dict() | {"covered_iou": covered}
            for photo, covered in self.covered()
        }
        return figures

    def covered(self) -> list[tuple[PhotographErrors, float]]:
        """Return each photograph with how well it is covered; none without any."""
        if self.photographs is None or self.coverage is None:
            return []
        return list(zip(self.photographs, self.coverage.iou, strict=True))

    def table(self) -> list[tuple[str, ...]]:
        """Return rows of text for people, the first row naming the columns."""
        rows: list[tuple[str, ...]] = [("", "precision", "recall", "F", "F signed")]
        parts = (("all", self.every), ("seen", self.visible), ("within", self.interior))
        for part, scores in parts:
            for score in scores or ():
                shares = (*score.unsigned, score.signed.f)
                title = f"{part}, {1e3 * score.radius:g} mm, {score.angle_deg:g}°"
                rows.append((title, *(f"{100 * share:.1f} %" for share in shares)))
        rows += [("", ""), *self.other_rows()]
        return rows

    def other_rows(self) -> list[tuple[str, ...]]:
        """Return the rows of all that is not a score."""
        shares = " ".join(f"{100 * share:.1f}" for share in self.consistency)
        rows: list[tuple[str, ...]] = [
            ("strand consistency", f"{shares} %"),
            ("median length", f"{100 * self.shape.median_length:+.1f} %"),
            ("length, at quantiles", f"{1e3 * self.shape.length:.1f} mm"),
            ("length, at roots", f"{1e3 * self.shape.length_at_root:.1f} mm"),
        ]
        if self.shape.median_curvature is not None and self.shape.curvature is not None:
            rows += [
                ("median curvature", f"{self.shape.median_curvature:+.2f} /m"),
                ("curvature, at quantiles", f"{self.shape.curvature:.2f} /m"),
            ]
        curls = self.curls
        shares = f"{100 * curls.share:.1f} %, true {100 * curls.true_share:.1f} %"
        rows += [
            ("strands that curl", shares),
            ("radius of curls", compare_text(curls.radius, curls.true_radius)),
            ("pitch of curls", compare_text(curls.pitch, curls.true_pitch)),
        ]
        if self.head is not None:
            rows += [
                ("inside the head", f"{100 * self.head.share_inside:.2f} %"),
                ("points deeper than 1 mm", f"{self.head.deep}"),
                ("deepest", f"{1e3 * self.head.deepest:.2f} mm"),
                ("rooted on the head", f"{100 * self.head.rooted:.1f} %"),
            ]
        for photo, covered in self.covered():
            angle = photo.median_angle_deg
            known = "unknown" if angle is None else f"{angle:.1f}°"
            shares = f"IoU {100 * photo.iou:.1f} %, covered {100 * covered:.1f} %"
            rows.append((f"photograph {photo.name}", f"{known}, {shares}"))
        return rows


@one_blas_thread()
def evaluate(
    strands: Strands,
    truth: Strands,
    *,
    head: Mesh | None,
    views: Sequence[View] | None,
) -> Evaluation:
    """Return how recovered strands compare with the true ones.

    Args:
        strands: The recovered strands.
        truth: The true strands.
        head: The head, in the same frame; None if unknown.
        views: Photographs that tell visible hair from that within, and that the strands
            are drawn over; None if there are none.

    Raises:
        InputError: If one of the two holds no strand with a length.
    """
    pred = sample_strands_evenly(strands, name="the recovered strands")
    true = sample_strands_evenly(truth, name="the true strands")
    hit = find_matches(pred, true, THRESHOLDS)
    found = find_matches(true, pred, THRESHOLDS)
    visible = interior = photographs = coverage = None
    if views:
        sights, drawn = look(head, views), even_strands(strands)
        seen = find_visible(pred, drawn, sights)
        true_seen = find_visible(true, even_strands(truth), sights)
        visible = summarise(keep(hit, seen), keep(found, true_seen), THRESHOLDS)
        interior = summarise(keep(hit, ~seen), keep(found, ~true_seen), THRESHOLDS)
        photographs = tuple(abreast(partial(compare_with_photograph, drawn), sights))
        coverage = fit_width(drawn, sights)
    return Evaluation(
        every=summarise(hit, found, THRESHOLDS),
        visible=visible,
        interior=interior,
        consistency=strand_consistency(pred, true),
        shape=compare_shapes(strands, truth),
        curls=compare_curls(strands, truth),
        head=None if head is None else compare_with_head(strands, pred, head),
        photographs=photographs,
        coverage=coverage,
    )


def curls_dict(curls: CurlErrors) -> dict[str, float | None]:
    """Return the figures of waves and curls by name."""
    return {
        "share": curls.share,
        "true_share": curls.true_share,
        "median_radius_m": curls.radius,
        "true_median_radius_m": curls.true_radius,
        "median_radius_relative": curls.radius_error,
        "median_pitch_m": curls.pitch,
        "true_median_pitch_m": curls.true_pitch,
        "median_pitch_relative": curls.pitch_error,
    }


def compare_text(found: float | None, true: float | None) -> str:
    """Return a length and the true one as text, in millimetres."""
    one, other = (
        "none" if length is None else f"{1e3 * length:.1f} mm"
        for length in (found, true)
    )
    return f"{one}, true {other}"


def keep(matches: Matches, mask: Bool[np.ndarray, " samples"]) -> Matches:
    """Return the matches of the points in `mask`."""
    return Matches(matches.unsigned[:, mask], matches.signed[:, mask])


def name_threshold(score: Score) -> str:
    """Return the name of a threshold, such as `3mm_30deg`."""
    return f"{1e3 * score.radius:g}mm_{score.angle_deg:g}deg"


def scores_dict(scores: tuple[Score, ...]) -> dict[str, Any]:
    """Return scores by the name of their threshold."""
    return {
        name_threshold(score): {
            "unsigned": rates_dict(score.unsigned),
            "signed": rates_dict(score.signed),
        }
        for score in scores
    }


def rates_dict(rates: Rates) -> dict[str, float]:
    """Return rates by name."""
    return {"precision": rates.precision, "recall": rates.recall, "f": rates.f}
