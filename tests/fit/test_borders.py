import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.fit.borders import draw_contours, move_starved, voted_reach
from hairfit.model.contour import ANGLES
from hairfit.model.ownership import contains


def within(contour, index, uv):
    """Whether places are inside one contour."""
    one = jax.tree.map(lambda leaf: leaf[index], contour)
    return np.asarray(jax.vmap(contains, (None, 0))(one, jnp.asarray(uv)))


@pytest.fixture
def sides():
    """Roots left and right of u = 0.5; which are right."""
    uv = np.random.default_rng(0).uniform(0.2, 0.8, (300, 2))
    return uv, (uv[:, 0] > 0.5).astype(int)


def test_a_contour_holds_all_own_roots_if_the_others_do_not_count(sides):
    uv, label = sides
    middle = np.stack([uv[label == k].mean(axis=0) for k in (0, 1)])
    contour = draw_contours(uv, label, middle, against=0.0, margin=0.02)
    for k in (0, 1):
        assert within(contour, k, uv[label == k]).all()


def test_a_contour_ends_where_the_roots_of_others_begin(sides):
    uv, label = sides
    label[:15] = 0  # some on the right belong to the left
    middle = np.array([[0.35, 0.5], [0.65, 0.5]])
    wide = draw_contours(uv, label, middle, against=0.0, margin=0.0)
    voted = draw_contours(uv, label, middle, against=1.0, margin=0.0)
    right = uv[uv[:, 0] > 0.56]
    assert within(wide, 0, right).mean() > 0.5
    assert within(voted, 0, right).mean() < 0.1


def test_the_reach_along_a_spoke_is_where_the_sum_of_votes_is_greatest():
    angle = 2.0 * np.pi / ANGLES * 4.5  # between the spokes 4 and 5
    distance = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    own = np.array([True, False, True, True, False])
    away = distance[:, None] * np.array([np.cos(angle), np.sin(angle)])
    reach = voted_reach(away, own, 1.0)
    assert np.allclose(reach[[4, 5]], 0.4)
    assert (np.delete(reach, [4, 5]) == 0.0).all()
    assert np.allclose(voted_reach(away, own, 3.0)[[4, 5]], 0.1)
    assert (voted_reach(away, ~own, 9.0) == 0.0).all()


def test_a_starved_centre_moves_to_its_root_that_is_farthest_from_all_others():
    uv = np.array([[0.1, 0.1], [0.5, 0.5], [0.9, 0.1], [0.3, 0.3]])
    label = np.array([0, 1, 1, 1])
    centre = np.array([[0.1, 0.1], [0.1, 0.1]])
    moved = move_starved(uv, label, centre, np.array([False, True]))
    assert np.array_equal(moved, [[0.1, 0.1], [0.9, 0.1]])
    assert np.array_equal(centre[1], [0.1, 0.1])
