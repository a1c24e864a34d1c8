import numpy as np
import pytest
from known_hair import moved, parallel, ragged, wild

from hairfit.evaluate.consistency import strand_consistency
from hairfit.evaluate.match import THRESHOLDS
from hairfit.evaluate.sample import sample_strands_evenly


def consistency(pred, truth, **options):
    pred, truth = sample_strands_evenly(pred), sample_strands_evenly(truth)
    return strand_consistency(pred, truth, **options)


def test_hair_is_consistent_with_itself():
    hair = wild(np.random.default_rng(0))
    assert consistency(hair, hair) == (1.0, 1.0, 1.0)


def test_a_strand_in_two_pieces_is_half_consistent():
    whole = ragged([[0, 0, 0], [0, -0.1, 0]])
    pieces = ragged([[0, 0, 0], [0, -0.05, 0]], [[0, -0.05, 0], [0, -0.1, 0]])
    # Points of the other half within the radius count for this one too.
    found = consistency(pieces, whole)
    assert np.allclose(found, [0.52, 0.53, 0.54], atol=0.011)


def test_the_best_of_many_strands_counts_and_not_their_union():
    truth = parallel(side=2)
    double = moved(truth, [1e-3, 0, 0])
    both = ragged(*truth.points.reshape(4, -1, 3), *double.points.reshape(4, -1, 3))
    assert consistency(both, truth) == (1.0, 1.0, 1.0)
    assert consistency(truth, moved(truth, [2.5e-3, 0, 0])) == (0.0, 1.0, 1.0)


def test_consistency_is_that_of_the_definition():
    rng = np.random.default_rng(2)
    p, t = (sample_strands_evenly(wild(rng, 12, 6, 0.01)) for _ in range(2))
    distance = np.linalg.norm(t.points[:, None] - p.points[None], axis=2)
    cosine = np.abs(t.directions @ p.directions.T)
    expected = []
    for radius, angle in THRESHOLDS:
        match = (distance <= radius) & (cosine >= np.cos(np.radians(angle)))
        best = [
            max(match[t.strand == s][:, p.strand == k].any(1).mean() for k in range(12))
            for s in range(12)
        ]
        expected.append(np.mean(best))
    assert strand_consistency(p, t) == pytest.approx(expected, abs=1e-12)


def test_a_draw_of_strands_is_repeatable():
    rng = np.random.default_rng(4)
    hair, other = wild(rng, 40), wild(rng, 40)
    drawn = consistency(hair, other, strands=10, seed=1)
    assert drawn == consistency(hair, other, strands=10, seed=1)
    assert all(0.0 <= share <= 1.0 for share in drawn)
