import numpy as np
import pytest

from hairfit.report.show import fewer_knots


def spirals(radius, turns=4.0, knots=40):
    """Return strands of 0.2 m that wind around a line."""
    t = np.linspace(0.0, 1.0, knots)
    angle = 2.0 * np.pi * turns * t
    path = np.stack([radius * np.cos(angle), 0.2 * t, radius * np.sin(angle)], axis=-1)
    return path + np.zeros((5, 1, 1))


@pytest.mark.parametrize("knots", [40, 33, 9])
def test_straight_strands_need_few_knots_and_keep_their_ends(knots):
    strands = spirals(0.0, knots=knots)
    found = fewer_knots(strands)
    assert found.shape == (5, (knots - 1) // 4 + 1, 3)
    assert (found[:, [0, -1]] == strands[:, [0, -1]]).all()


def test_curls_keep_the_knots_that_show_them():
    assert (fewer_knots(spirals(0.01)) == spirals(0.01)).all()
    # One turn of 2 mm: half of the knots are enough, a quarter is not.
    assert fewer_knots(spirals(0.002, turns=3.0)).shape[1] == 20
    assert fewer_knots(spirals(0.01)[:, :2]).shape[1] == 2
