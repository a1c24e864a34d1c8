import numpy as np

from hairfit.report.show import FEWEST_KNOTS, with_few_knots


def arcs(radius: float, knots: int) -> np.ndarray:
    """Return half circles, `(3, knots, 3)`, in metres."""
    turn = np.linspace(0.0, np.pi, knots)
    one = radius * np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    return np.stack([one, one + 0.01, one - 0.01])


def test_knots_are_left_out_where_pictures_do_not_show_it():
    """A chord over two of n segments is r (1 - cos(pi / n)) away from its arc."""
    strands, segments = arcs(0.1, 41), 40
    away = 0.1 * (1.0 - np.cos(np.pi / segments))
    assert with_few_knots(strands, 0.99 * away).shape == strands.shape
    few = with_few_knots(strands, 1.01 * away)
    assert np.array_equal(few, strands[:, ::2])


def test_roots_and_tips_stay_and_a_few_knots_are_left():
    line = np.linspace([0.0, 0.0, 0.0], [0.0, 0.2, 0.0], 40)[None]
    few = with_few_knots(line, 1e-6)
    assert 2 < few.shape[1] <= FEWEST_KNOTS
    assert np.array_equal(few[:, [0, -1]], line[:, [0, -1]])
