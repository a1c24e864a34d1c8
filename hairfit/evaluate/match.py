"""Precision and recall of strands: which points have a neighbour that runs their way.

A point is matched when any point of the other set lies within a radius and runs within
an angle of it. All neighbours are looked at, not the nearest few: in dense hair the few
nearest may all belong to strands that cross. Undirected this is HairGS's measure (its
`bidirectional=True`); directed, hair that grows the wrong way does not count.
"""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int

from ..types import Strands
from .pairs import SLACK, Cubes, Pairs, visit_pairs
from .sample import Samples, sample_strands_evenly

THRESHOLDS = ((2e-3, 20.0), (3e-3, 30.0), (4e-3, 40.0))
"""The customary radii, in metres, and angles, in degrees."""

EARLY = ((0.6, 8), (1.5, 24))
"""Cubes whose targets are tried before all are: width over radius, and how many."""


class Rates(NamedTuple):
    """Shares in [0, 1]: matched of the predicted, of the true, their harmonic mean."""

    precision: float
    recall: float
    f: float


@dataclasses.dataclass(frozen=True)
class Score:
    """How well strands match at one threshold.

    Attributes:
        radius: Largest distance of a match, in metres.
        angle_deg: Largest angle of a match, in degrees.
        unsigned: Strands as lines: the sign of growth is ignored.
        signed: Strands from root to tip.
    """

    radius: float
    angle_deg: float
    unsigned: Rates
    signed: Rates


class Matches(NamedTuple):
    """Which points are matched, one row for each threshold."""

    unsigned: Bool[np.ndarray, "thresholds samples"]
    signed: Bool[np.ndarray, "thresholds samples"]


class EarlyMatches(NamedTuple):
    """Which points are matched as lines, and which as ways from root to tip."""

    line: Bool[np.ndarray, " samples"]
    way: Bool[np.ndarray, " samples"]


def score(
    pred: Strands,
    truth: Strands,
    thresholds: Sequence[tuple[float, float]] = THRESHOLDS,
    *,
    sample: int | None = None,
    seed: int = 0,
) -> tuple[Score, ...]:
    """Return precision, recall and F of `pred` against `truth`.

    Args:
        pred: The recovered strands.
        truth: The true strands.
        thresholds: Radius in metres and angle in degrees, at most 90, of each score.
        sample: Count only this many points of each set, drawn at random; they still
            match against all points of the other set, so the score has no bias.
        seed: Seed of that draw.

    Returns:
        One score for each threshold.

    Raises:
        InputError: If one of the two holds no strand with a length.
    """
    p = sample_strands_evenly(pred, name="the recovered strands")
    t = sample_strands_evenly(truth, name="the true strands")
    rng = np.random.default_rng(seed)
    hit = find_matches(draw(p, sample, rng), t, thresholds)
    found = find_matches(draw(t, sample, rng), p, thresholds)
    return summarise(hit, found, thresholds)


def draw(samples: Samples, count: int | None, rng: np.random.Generator) -> Samples:
    """Return `count` of the samples at random, or all when `count` is None."""
    size = len(samples.points)
    if count is None or count >= size:
        return samples
    return samples.take(np.sort(rng.choice(size, count, replace=False)))


def summarise(
    hit: Matches, found: Matches, thresholds: Sequence[tuple[float, float]]
) -> tuple[Score, ...]:
    """Return the scores that follow from the matched points of both sets.

    Args:
        hit: Which recovered points are matched.
        found: Which true points are matched.
        thresholds: Radius and angle of each row.
    """
    return tuple(
        Score(
            radius=float(radius),
            angle_deg=float(angle),
            unsigned=make_rates(hit.unsigned[k], found.unsigned[k]),
            signed=make_rates(hit.signed[k], found.signed[k]),
        )
        for k, (radius, angle) in enumerate(thresholds)
    )


def make_rates(hit: Bool[np.ndarray, " p"], found: Bool[np.ndarray, " t"]) -> Rates:
    """Return the rates; of no points the share is 0."""
    precision = float(hit.mean()) if hit.size else 0.0
    recall = float(found.mean()) if found.size else 0.0
    total = precision + recall
    return Rates(precision, recall, 2 * precision * recall / total if total else 0.0)


def find_matches(
    queries: Samples, targets: Samples, thresholds: Sequence[tuple[float, float]]
) -> Matches:
    """Return which `queries` have a match among `targets`, exactly.

    Most points that have a match have one right beside them, so a few neighbours are
    tried first. Only those points meet all targets within the radius for which the
    tightest threshold is still open then.
    """
    if not all(radius > 0 and 0 <= angle <= 90 for radius, angle in thresholds):
        raise ValueError(
            f"`thresholds` need radii above 0 and angles of 0 to 90 degrees, got "
            f"{thresholds}."
        )
    tight = (min(r for r, _ in thresholds), min(a for _, a in thresholds))
    loose = (max(r for r, _ in thresholds), max(a for _, a in thresholds))
    line, way = match_early(queries, targets, *tight)
    matches = Matches(
        np.repeat(line[None], len(thresholds), 0),
        np.repeat(way[None], len(thresholds), 0),
    )

    def fill(block: Pairs) -> None:
        for k, (radius, angle) in enumerate(thresholds):
            fits = block.choose(radius, angle)
            # No query comes from two threads, so these do not meet.
            matches.unsigned[k, block.query[fits]] = True
            matches.signed[k, block.query[fits & (block.cosine > 0)]] = True

    visit_pairs(queries, targets, *loose, fill, wanted=~way, directed=line)
    return matches


def match_early(
    queries: Samples, targets: Samples, radius: float, angle_deg: float
) -> EarlyMatches:
    """Return the matches among a few targets in the cube around each query."""
    count = len(queries.points)
    early = EarlyMatches(np.zeros(count, bool), np.zeros(count, bool))
    for share, attempts in EARLY:
        cubes = Cubes.build(targets.points, share * radius)
        left = np.flatnonzero(~early.way)
        first, last = cubes.span(queries.points[left])
        size = last - first
        for attempt in range(attempts):
            # Cubes with more targets than attempts are tried at even distances.
            open_ = np.flatnonzero((size > attempt) & ~early.way[left])
            entry = size[open_] * attempt // np.minimum(size[open_], attempts)
            other = cubes.order[first[open_] + entry]
            try_pairs(queries, targets, left[open_], other, radius, angle_deg, early)
    return early


def try_pairs(
    queries: Samples,
    targets: Samples,
    index: Int[np.ndarray, " pairs"],
    other: Int[np.ndarray, " pairs"],
    radius: float,
    angle_deg: float,
    early: EarlyMatches,
) -> None:
    """Mark the queries `index` that match the targets `other`."""
    gap = queries.points[index] - targets.points[other]
    near = np.einsum("ij,ij->i", gap, gap) <= (radius * (1 + SLACK)) ** 2
    cosine = np.cos(np.radians(angle_deg)) - SLACK
    along = np.einsum("ij,ij->i", queries.directions[index], targets.directions[other])
    early.line[index] |= near & (np.abs(along) >= cosine)
    early.way[index] |= near & (along >= cosine)
