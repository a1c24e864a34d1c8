import numpy as np
import pytest
from known_hair import moved, parallel, ragged

from hairfit.errors import InputError
from hairfit.evaluate.sample import sample_strands_evenly
from hairfit.types import Strands


def test_points_lie_a_millimetre_apart_and_leave_out_the_tip():
    strands = ragged([[0, 0, 0], [0, 0.01, 0]], [[1, 0, 0], [1, 0, 0.0025]])
    samples = sample_strands_evenly(strands)
    assert np.bincount(samples.strand).tolist() == [10, 3]
    assert np.allclose(samples.points[:10, 1], np.arange(10) * 1e-3)
    assert np.allclose(samples.points[10:, 2], [0, 1e-3, 2e-3])
    assert np.allclose(samples.directions[:10], [0, 1, 0])
    assert np.allclose(samples.directions[10:], [0, 0, 1])


def test_distance_is_along_the_strand_and_direction_that_of_the_segment():
    bend = ragged([[0, 0, 0], [0.0015, 0, 0], [0.0015, 0.0015, 0]])
    samples = sample_strands_evenly(bend)
    assert np.allclose(samples.points[:, :2], [[0, 0], [1e-3, 0], [1.5e-3, 0.5e-3]])
    assert np.allclose(samples.directions, [[1, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_a_joint_belongs_to_the_segment_towards_the_tip():
    bend = ragged([[0, 0, 0], [0.001, 0, 0], [0.001, 0.001, 0]])
    assert np.allclose(sample_strands_evenly(bend).directions[1], [0, 1, 0])


def test_repeated_points_and_single_points_do_no_harm():
    line = [[0, 0, 0], [0, 0, 0], [0, 0.002, 0], [0, 0.002, 0], [0, 0.004, 0]]
    strands = ragged(line, [[5, 5, 5]], [[6, 0, 0], [6, 0, 0]], line[::-1])
    samples = sample_strands_evenly(strands)
    assert np.bincount(samples.strand).tolist() == [4, 0, 0, 4]
    assert np.allclose(samples.directions[:4], [0, 1, 0])
    assert np.allclose(samples.directions[4:], [0, -1, 0])
    assert np.allclose(np.linalg.norm(samples.directions, axis=1), 1)


def test_float32_points_far_from_the_origin_stay_on_their_strand():
    strands = moved(parallel(side=30, knots=40), [0.3, 0.2, 0.1])
    single = Strands(strands.points.astype(np.float32), strands.offsets)
    samples = sample_strands_evenly(single)
    assert np.allclose(samples.directions, [0, -1, 0], atol=1e-4)
    assert samples.points[:, 1].min() >= 0.15 - 1e-6


@pytest.mark.parametrize(
    ("strands", "message"),
    [
        (Strands(np.zeros((0, 3)), np.array([0])), "the hair hold no strand"),
        (ragged([[0, 0, 0]], [[1, 1, 1]]), "the hair have no length"),
        (ragged([[0, 0, 0], [0, 0, 0]]), "the hair have no length"),
        (ragged([[0, 0, 0], [np.nan, 0, 0]]), "the hair hold points that are not fin"),
        (ragged([[0, 0, 0], [0, 25, 0]]), "the hair are 25 m long .* scale them to"),
        (
            ragged([[0, 0, 0], [0, 0.2, 0]], [[0, 5e9, 0], [0, 5e9, 0.1]]),
            r"5e\+09 m wide in all; scale them to metres",
        ),
    ],
)
def test_what_cannot_be_counted_is_refused(strands, message):
    with pytest.raises(InputError, match=message):
        sample_strands_evenly(strands, name="the hair")
