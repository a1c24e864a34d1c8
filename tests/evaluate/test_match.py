import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st
from known_hair import moved, parallel, ragged, wild

from hairfit.errors import InputError
from hairfit.evaluate import THRESHOLDS, score
from hairfit.evaluate.match import find_matches
from hairfit.evaluate.sample import Samples, sample_strands_evenly
from hairfit.types import Strands


def slow_matches(queries, targets, thresholds):
    """Return what is matched by the definition, all pairs at once, and the ties."""
    gap = queries.points[:, None] - targets.points[None]
    distance = np.sqrt((gap**2).sum(2))
    cosine = queries.directions @ targets.directions.T
    unsigned, signed, tie = [], [], False
    for radius, angle in thresholds:
        limit = np.cos(np.radians(angle))
        near = distance <= radius
        unsigned.append((near & (np.abs(cosine) >= limit)).any(1))
        signed.append((near & (cosine >= limit)).any(1))
        tie |= bool((np.abs(distance / radius - 1) < 1e-7).any())
        tie |= bool((np.abs(np.abs(cosine) - limit) < 1e-7).any())
    return np.array(unsigned), np.array(signed), tie


def test_hair_against_itself_is_perfect():
    hair = wild(np.random.default_rng(0))
    for result in score(hair, hair):
        assert result.unsigned == (1.0, 1.0, 1.0) and result.signed == (1.0, 1.0, 1.0)


def test_a_shift_of_2_5_mm_fails_at_2_mm_and_passes_at_3_mm():
    hair = parallel()
    two, three, four = score(moved(hair, [2.5e-3, 0, 0]), hair)
    assert two.unsigned == (0.0, 0.0, 0.0) and two.signed == (0.0, 0.0, 0.0)
    assert three.unsigned == (1.0, 1.0, 1.0) and three.signed == (1.0, 1.0, 1.0)
    assert four.unsigned == (1.0, 1.0, 1.0) and four.signed == (1.0, 1.0, 1.0)
    assert (two.radius, two.angle_deg) == (2e-3, 20.0)


def test_a_shift_by_the_radius_itself_still_counts():
    hair = parallel()
    assert score(moved(hair, [2e-3, 0, 0]), hair)[0].unsigned.f == 1.0


def test_reversed_strands_lose_the_signed_score_only():
    hair = parallel()
    back = hair.points.reshape(hair.count, -1, 3)[:, ::-1].reshape(-1, 3)
    for result in score(Strands(back, hair.offsets), hair):
        assert result.unsigned == (1.0, 1.0, 1.0)
        assert result.signed == (0.0, 0.0, 0.0)


def test_turned_strands_fail_by_their_angle():
    tilt = np.radians(25.0)
    across = ragged([[0, 0, 0], [0.002 * np.sin(tilt), -0.002 * np.cos(tilt), 0]])
    straight = ragged([[0, 0, 0], [0, -0.002, 0]])
    two, three, _ = score(across, straight)
    assert two.unsigned.f == 0.0 and three.unsigned.f == 1.0


def test_half_of_the_hair_has_full_precision_and_half_the_recall():
    hair = parallel()
    half = Strands(hair.points[: len(hair.points) // 2], hair.offsets[: 8 + 1])
    for result in score(half, hair):
        assert result.unsigned == (1.0, 0.5, 2 / 3)


def test_a_match_counts_however_many_crossing_hairs_are_nearer():
    rng = np.random.default_rng(1)
    count = 5000
    place = np.concatenate(
        [rng.uniform(-1e-3, 1e-3, (count, 3)), [[0, 0, 1.99e-3]]]
    )  # all nearer than the last, and all but the last across
    way = np.tile([1.0, 0, 0], (count + 1, 1))
    way[-1] = [0, 0, -1]
    crowd = Samples(place, way, np.arange(count + 1))
    one = Samples(np.zeros((1, 3)), np.array([[0.0, 0, 1]]), np.array([0]))
    found = find_matches(one, crowd, THRESHOLDS)
    assert found.unsigned.all() and not found.signed.any()
    assert not find_matches(one, crowd, [(1.98e-3, 20.0)]).unsigned.any()


@hypothesis.given(
    seed=st.integers(0, 10_000),
    size=st.floats(1e-3, 0.05),
    strands=st.integers(1, 30),
    others=st.integers(1, 30),
    step=st.floats(1e-3, 5e-3),
)
@hypothesis.settings(max_examples=60, deadline=None)
def test_matches_are_those_of_the_definition(seed, size, strands, others, step):
    rng = np.random.default_rng(seed)
    p = sample_strands_evenly(wild(rng, strands, 6, size, step))
    t = sample_strands_evenly(wild(rng, others, 6, size, step))
    unsigned, signed, tie = slow_matches(p, t, THRESHOLDS)
    hypothesis.assume(not tie)
    found = find_matches(p, t, THRESHOLDS)
    assert np.array_equal(found.unsigned, unsigned)
    assert np.array_equal(found.signed, signed)


@pytest.mark.parametrize("size", [5e-3, 0.05])
def test_crowded_hair_is_matched_by_the_definition(size):
    rng = np.random.default_rng(3)
    p, t = (sample_strands_evenly(wild(rng, 60, 8, size, 5e-3)) for _ in range(2))
    unsigned, signed, tie = slow_matches(p, t, THRESHOLDS)
    assert not tie
    found = find_matches(p, t, THRESHOLDS)
    assert np.array_equal(found.unsigned, unsigned)
    assert np.array_equal(found.signed, signed)


@pytest.mark.parametrize(
    "thresholds", [[(4e-3, 10.0), (2e-3, 50.0)], [(3e-3, 90.0)], [(1e-3, 5.0)] * 2]
)
def test_thresholds_need_not_be_nested(thresholds):
    rng = np.random.default_rng(5)
    p, t = (sample_strands_evenly(wild(rng, 25, 6, 0.01)) for _ in range(2))
    unsigned, signed, tie = slow_matches(p, t, thresholds)
    assert not tie
    found = find_matches(p, t, thresholds)
    assert np.array_equal(found.unsigned, unsigned)
    assert np.array_equal(found.signed, signed)


def test_hair_far_away_matches_nothing():
    hair = parallel()
    for result in score(moved(hair, [0, 50, 0]), hair):
        assert result.unsigned == (0.0, 0.0, 0.0)


def test_a_draw_of_points_estimates_the_score():
    rng = np.random.default_rng(7)
    hair, other = wild(rng, 150), wild(rng, 150)
    size = len(sample_strands_evenly(other).points)
    exact = score(other, hair)
    assert score(other, hair, sample=10 * size) == exact
    drawn = score(other, hair, sample=1000, seed=1)
    assert drawn == score(other, hair, sample=1000, seed=1)
    for mine, true in zip(drawn, exact, strict=True):
        p = true.unsigned.precision
        assert abs(mine.unsigned.precision - p) < 4 * np.sqrt(p * (1 - p) / 1000)


def test_no_hair_is_refused_by_name():
    hair, none = parallel(), Strands(np.zeros((0, 3)), np.array([0]))
    with pytest.raises(InputError, match="the recovered strands hold no strand"):
        score(none, hair)
    with pytest.raises(InputError, match="the true strands hold no strand"):
        score(hair, none)


@pytest.mark.parametrize("threshold", [(0.0, 20.0), (2e-3, 120.0)])
def test_thresholds_that_mean_nothing_are_refused(threshold):
    with pytest.raises(ValueError, match="`thresholds` need radii above 0"):
        score(parallel(), parallel(), [threshold])
