import numpy as np
import pytest
from known_hair import lines, striped

from hairfit.evaluate.photographs import (
    compare_with_photograph,
    overlap,
    weigh,
)
from hairfit.evaluate.visibility import Sight


@pytest.mark.parametrize("turn", [0.0, 20.0, 80.0])
def test_the_angle_of_drawn_hair_is_measured(turn):
    errors = compare_with_photograph(lines(30.0 + turn), Sight(striped(30.0), None))
    assert errors.median_angle_deg == pytest.approx(turn, abs=4.0)
    assert errors.mean_angle_deg == pytest.approx(turn, abs=4.0)


def test_hair_that_fills_the_picture_overlaps_by_the_mask_s_share():
    hair = lines(30.0, count=600, size=0.2)
    errors = compare_with_photograph(hair, Sight(striped(30.0), None))
    assert errors.iou == pytest.approx(64**2 / 96**2, abs=0.01)


def test_hair_elsewhere_has_no_angle_and_no_overlap():
    errors = compare_with_photograph(lines(30.0) + 9.0, Sight(striped(30.0), None))
    assert errors.mean_angle_deg is None and errors.median_angle_deg is None
    assert errors.iou == 0.0


def test_means_and_medians_are_weighted():
    errors = weigh(np.array([3.0, 1.0, 2.0]), np.array([1.0, 1.0, 6.0]))
    assert errors.mean == pytest.approx(2.0) and errors.median == 2.0


def test_overlap_counts_common_over_either():
    left, right = np.zeros((4, 4), bool), np.zeros((4, 4), bool)
    assert overlap(left, right) == 1.0
    left[:, :3], right[:, 1:] = True, True
    assert overlap(left, right) == 0.5
