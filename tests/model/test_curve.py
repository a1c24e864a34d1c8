import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit.model import arc_length, catmull_rom, catmull_rom_weights, resample

WAVE = jnp.array([[0.0, 0, 0], [1, 2, 0], [3, 1, 1], [4, 0, -1], [5, 3, 2]])


def test_the_curve_runs_through_its_control_points():
    points = catmull_rom_weights(5, jnp.linspace(0.0, 1.0, 5)) @ WAVE
    assert jnp.allclose(points, WAVE, atol=1e-14)
    assert jnp.array_equal(points[0], WAVE[0])


def test_the_curve_has_the_closed_form_of_catmull_and_rom():
    p = np.asarray(WAVE)
    f = 0.3  # between control points 1 and 2
    want = 0.5 * (
        2 * p[1]
        + (p[2] - p[0]) * f
        + (2 * p[0] - 5 * p[1] + 4 * p[2] - p[3]) * f**2
        + (3 * p[1] - p[0] - 3 * p[2] + p[3]) * f**3
    )
    assert jnp.allclose(catmull_rom(WAVE, 1.3 / 4), want, atol=1e-14)


@pytest.mark.parametrize("knots", [2, 3, 9])
def test_a_straight_line_stays_straight_and_even_beyond_its_ends(knots):
    t = jnp.linspace(-0.5, 1.5, 21)
    line = jnp.linspace(0.0, 1.0, knots)[:, None]
    assert jnp.allclose(catmull_rom_weights(knots, t) @ line, t[:, None], atol=1e-13)


@pytest.mark.parametrize("order", [1, 2])
def test_derivatives_are_those_of_the_curve(order):
    t = jnp.array([-0.2, 0.0, 0.1, 0.33, 0.49, 0.9, 1.1])
    slope = jax.jacfwd(lambda t: catmull_rom_weights(5, t[None], order - 1)[0])
    want = jax.jit(jax.vmap(slope))(t)
    got = catmull_rom_weights(5, t, order)
    ends = order == 2 and jnp.isin(
        t, jnp.array([0.0, 1.0])
    )  # the curvature jumps there
    keep = ~jnp.asarray(ends) & jnp.ones(len(t), bool)
    assert jnp.allclose(got[keep], want[keep], atol=1e-12)


def test_one_control_point_is_refused():
    with pytest.raises(ValueError, match="at least 2 control points, got 1"):
        catmull_rom_weights(1, jnp.zeros(1))


def test_arc_length_adds_up_segments():
    points = jnp.array([[0.0, 0, 0], [3, 4, 0], [3, 4, 0], [3, 4, 2]])
    assert jnp.array_equal(arc_length(points), jnp.array([0.0, 5, 5, 7]))


def test_resampled_points_are_at_equal_distances_on_the_polyline():
    points = jnp.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 3, 0]])
    want = jnp.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 2, 0], [1, 3, 0]])
    assert jnp.allclose(resample(points, 5), want, atol=1e-14)


def test_gradients_of_curves():
    check_grads(jax.jit(catmull_rom), (WAVE, 0.37), order=1)
    check_grads(jax.jit(arc_length), (WAVE,), order=1)
    check_grads(jax.jit(lambda p: resample(p, 7)), (WAVE,), order=1)


def test_gradients_are_finite_where_points_coincide():
    still = jnp.zeros((4, 3))
    for function in (arc_length, lambda p: resample(p, 5)):
        assert jnp.all(jnp.isfinite(jax.jit(jax.jacrev(function))(still)))
