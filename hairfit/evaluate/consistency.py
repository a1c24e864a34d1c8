"""How far true strands are recovered by one strand each, and not by pieces of many."""

from collections.abc import Sequence

import numpy as np

from .match import THRESHOLDS
from .pairs import Pairs, visit_pairs
from .sample import Samples

STRANDS = 300
"""How many true strands are looked at; all of a dense groom would take hours."""


def strand_consistency(
    pred: Samples,
    truth: Samples,
    thresholds: Sequence[tuple[float, float]] = THRESHOLDS,
    *,
    strands: int = STRANDS,
    seed: int = 0,
) -> tuple[float, ...]:
    """Return how much of a true strand one single recovered strand matches.

    For each true strand it is the greatest share of its points that have a match on the
    same recovered strand; the mean over strands is what HairGS calls strand
    consistency. Matches are undirected.

    Args:
        pred: Points on the recovered strands.
        truth: Points on the true strands.
        thresholds: Radius in metres and angle in degrees of each result.
        strands: How many true strands to look at, drawn at random.
        seed: Seed of that draw.

    Returns:
        The mean share for each threshold, in [0, 1].
    """
    some = draw_strands(truth, strands, np.random.default_rng(seed))
    width = int(pred.strand.max()) + 1
    found: list[list[np.ndarray]] = [[] for _ in thresholds]

    def collect(block: Pairs) -> None:
        key = block.query * width + pred.strand[block.target]
        for k, (radius, angle) in enumerate(thresholds):
            found[k].append(np.unique(key[block.choose(radius, angle)]))

    loose = (max(r for r, _ in thresholds), max(a for _, a in thresholds))
    count = len(some.points)
    visit_pairs(
        some,
        pred,
        *loose,
        collect,
        wanted=np.ones(count, bool),
        directed=np.zeros(count, bool),
    )
    return tuple(mean_best_share(some, keys, width) for keys in found)


def draw_strands(truth: Samples, count: int, rng: np.random.Generator) -> Samples:
    """Return the samples of `count` strands at random, or all when there are fewer."""
    present = np.unique(truth.strand)
    if count >= len(present):
        return truth
    chosen = rng.choice(present, count, replace=False)
    return truth.take(np.isin(truth.strand, chosen))


def mean_best_share(samples: Samples, keys: list[np.ndarray], width: int) -> float:
    """Return the mean over strands of the best single match's share of points.

    Args:
        samples: Points on the true strands.
        keys: Matches, `point * width + recovered strand`; some may come twice.
        width: Number of recovered strands.
    """
    names, strand = np.unique(samples.strand, return_inverse=True)
    size = np.bincount(strand)
    best = np.zeros(len(names))
    if keys:
        # A point counts once for a recovered strand, however often they meet.
        point, other = np.divmod(np.unique(np.concatenate(keys)), width)
        pair, hits = np.unique(strand[point] * width + other, return_counts=True)
        np.maximum.at(best, pair // width, hits)
    return float(np.mean(best / size))
