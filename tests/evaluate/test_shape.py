import numpy as np
import pytest
from known_hair import parallel, ragged

from hairfit.evaluate.shape import compare_shapes, curvatures, strand_lengths
from hairfit.types import Strands


def arcs(radius, count=5, angle=2.0):
    turn = np.linspace(0, angle, 2000)
    arc = radius * np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    return Strands.from_array(np.repeat(arc[None], count, 0))


def test_hair_has_its_own_shape():
    errors = compare_shapes(arcs(0.05), arcs(0.05))
    assert errors.median_length == 0.0 and errors.length == 0.0
    assert errors.length_at_root == pytest.approx(0.0, abs=1e-12)
    assert errors.median_curvature == 0.0 and errors.curvature == 0.0


@pytest.mark.parametrize("radius", [0.02, 0.05, 1.0])
def test_a_circle_has_the_curvature_of_its_radius(radius):
    found = curvatures(arcs(radius, angle=1.0))
    assert len(found) and np.allclose(
        found, 1 / radius, rtol=5e-3
    )  # points are float32


def test_straight_hair_is_not_curved():
    assert np.allclose(curvatures(parallel()), 0.0, atol=1e-3)


def test_curvatures_of_two_circles_differ_by_the_closed_form():
    errors = compare_shapes(arcs(0.02), arcs(0.05))
    assert errors.median_curvature == pytest.approx(50 - 20, rel=1e-3)
    assert errors.curvature == pytest.approx(50 - 20, rel=1e-3)


def test_hair_too_short_to_bend_has_no_curvature():
    errors = compare_shapes(parallel(length=0.009), parallel())
    assert errors.median_curvature is None and errors.curvature is None


def test_hair_a_tenth_too_long_says_so():
    errors = compare_shapes(parallel(length=0.055), parallel(length=0.05))
    assert errors.median_length == pytest.approx(0.1, rel=1e-5)
    assert errors.length == pytest.approx(0.005, rel=1e-5)
    assert errors.length_at_root == pytest.approx(0.005, rel=1e-5)


def test_lengths_may_agree_as_a_whole_but_not_at_the_roots():
    long, short = [[0, 0, 0], [0, -0.2, 0]], [[1, 0, 0], [1, -0.1, 0]]
    swapped = ragged([[0, 0, 0], [0, -0.1, 0]], [[1, 0, 0], [1, -0.2, 0]])
    errors = compare_shapes(swapped, ragged(long, short))
    assert errors.length == pytest.approx(0.0, abs=1e-12)
    assert errors.length_at_root == pytest.approx(0.1)


def test_lengths_are_along_the_strand():
    hair = ragged(
        [[0, 0, 0], [0, 3, 0], [4, 3, 0]], [[9, 9, 9]], [[0, 0, 0], [0, 0, 2]]
    )
    assert np.allclose(strand_lengths(hair), [7, 0, 2])
