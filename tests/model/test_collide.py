import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads
from scipy.interpolate import RegularGridInterpolator

from hairfit.model.collide import (
    DistanceField,
    field_distance,
    push_out_points,
    push_out_strands,
    push_out_tree,
    sample_field,
)
from hairfit.model.maps import ScalpMaps
from hairfit.model.wisp import Wisps

RADIUS, CELL, GAP = 0.08, 0.004, 0.0005
SIDE = np.full(3, 0.1)


def ball_distance(p):
    return np.linalg.norm(p, axis=-1) - RADIUS


@pytest.fixture(scope="module")
def ball() -> DistanceField:
    return sample_field(ball_distance, -SIDE, SIDE, CELL)


@jax.jit
def look(field, points):
    return jax.vmap(field_distance, (None, 0))(field, points)


def around(count, low, high, seed=0):
    """Points at distances from `low` to `high` from the origin."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    return jnp.asarray(way * rng.uniform(low, high, (count, 1)))


def lengths(points):
    return np.linalg.norm(np.asarray(points), axis=-1)


def test_between_the_points_of_the_grid_the_distance_is_trilinear():
    rng = np.random.default_rng(0)
    values, origin = rng.normal(size=(4, 5, 6)), np.array([0.3, -0.2, 0.1])
    field = DistanceField(jnp.asarray(origin), jnp.array(0.1), jnp.asarray(values))
    axes = [origin[i] + 0.1 * np.arange(values.shape[i]) for i in range(3)]
    slow = RegularGridInterpolator(axes, values)
    p = origin + rng.uniform(1e-6, 1.0, (300, 3)) * 0.1 * (np.array(values.shape) - 1)
    assert np.allclose(look(field, jnp.asarray(p)).distance, slow(p), atol=1e-12)


def test_the_distance_from_a_ball_is_off_by_less_than_its_bound(ball):
    p = around(500, 0.03, 0.099)
    error = np.asarray(look(ball, p).distance) - ball_distance(np.asarray(p))
    closest = lengths(p) - np.sqrt(3.0) * CELL  # of the corners of the point's cell
    assert (error > -1e-12).all()  # the distance from a ball is convex
    assert (error < CELL**2 / (4.0 * closest)).all()
    assert error.max() > 1e-5


def test_the_gradient_at_a_ball_is_its_radius_to_second_order(ball):
    p = around(500, 0.04, 0.095)
    radius = np.asarray(p) / lengths(p)[:, None]
    error = np.linalg.norm(np.asarray(look(ball, p).gradient) - radius, axis=1)
    assert error.max() < (CELL / 0.035) ** 2
    finer = sample_field(ball_distance, -SIDE, SIDE, CELL / 2)
    half = np.linalg.norm(np.asarray(look(finer, p).gradient) - radius, axis=1)
    assert half.mean() < 0.3 * error.mean()


@settings(max_examples=40, deadline=None)
@given(
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda n: np.linalg.norm(n) > 0.1),
    st.floats(-0.5, 0.5),
    st.tuples(*[st.floats(0.0, 1.0)] * 3),
    st.floats(0.0, 0.2),
)
def test_before_a_plane_everything_is_exact(normal, height, share, gap):
    n = np.array(normal) / np.linalg.norm(normal)
    field = sample_field(lambda x: x @ n - height, -np.ones(3), np.ones(3), 0.5)
    p = 2.0 * np.array(share) - 1.0
    found = look(field, jnp.asarray(p)[None])
    assert np.isclose(found.distance[0], p @ n - height, atol=1e-12)
    assert np.allclose(found.gradient[0], n, atol=1e-12)
    low = min(p @ n - height - gap, 0.0)
    out = np.asarray(push_out_points(field, jnp.asarray(p)[None], gap))[0]
    # What leaves the grid on its way is let go; the first step is the exact one.
    assert np.allclose(out, p - low * n, atol=1e-12)


def test_what_is_in_a_ball_lands_above_it_on_its_own_radius(ball):
    p = around(400, 0.02, RADIUS + GAP)
    out = np.asarray(push_out_points(ball, p, GAP))
    radius = np.asarray(p) / lengths(p)[:, None]
    error = np.linalg.norm(out - (RADIUS + GAP) * radius, axis=1)
    shallow = lengths(p) > 0.06
    assert error[shallow].max() < 2e-4
    assert error.max() < 1e-3
    # As high as the bound of the interpolation lets it be.
    assert (lengths(out) > RADIUS + GAP - 6e-5).all()
    assert (lengths(out)[shallow] < RADIUS + GAP + 5e-5).all()


def test_even_the_middle_of_a_ball_gets_out(ball):
    p = around(200, 0.0005, 0.02)
    assert (lengths(push_out_points(ball, p, GAP)) > RADIUS).all()


def test_nothing_above_the_gap_or_outside_the_grid_moves(ball):
    above = around(300, RADIUS + GAP + 1e-6, 0.3)
    assert np.array_equal(push_out_points(ball, above, GAP), above)
    # A body that is cut by the grid's border has an inside beyond it.
    half = sample_field(lambda p: p[:, 1], -SIDE, SIDE, 0.02)
    beyond = jnp.array([[0.0, -0.11, 0.0], [0.2, -0.01, 0.0], [jnp.nan, 0.0, 0.0]])
    out = push_out_points(half, beyond, 0.001)
    assert np.array_equal(out, beyond, equal_nan=True)
    assert np.isinf(look(half, beyond).distance).all()
    assert (np.asarray(look(half, beyond).gradient) == 0.0).all()


@pytest.fixture(scope="module")
def bodies() -> DistanceField:
    return sample_field(two_balls, -SIDE, SIDE, CELL)


def two_balls(p):
    """A body with a waist, where its distance has creases in- and outside."""
    apart = np.array([0.035, 0.0, 0.0])
    both = [np.linalg.norm(p - s * apart, axis=-1) - 0.05 for s in (-1.0, 1.0)]
    return np.minimum(*both)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 0.004))
def test_after_it_nothing_is_inside_and_once_more_does_nothing(bodies, seed, gap):
    p = np.random.default_rng(seed).uniform(-0.095, 0.095, (64, 3))
    out = push_out_points(bodies, jnp.asarray(p), gap)
    exact = two_balls(np.asarray(out))
    assert exact.min() > gap - 1.2e-4
    again = push_out_points(bodies, out, gap)
    assert lengths(again - out).max() < 1e-5
    # No point is moved much further than the way out is long.
    assert (lengths(out - p) < 2.0 * np.maximum(gap - two_balls(p), 0.0) + 1e-3).all()


def test_neighbours_stay_neighbours(ball):
    t = np.linspace(-0.05, 0.05, 4000)
    line = np.stack([t, np.full_like(t, 0.06), 0.3 * t], axis=1)
    out = np.asarray(push_out_points(ball, jnp.asarray(line), GAP))
    step = lengths(np.diff(out, axis=0)) / lengths(np.diff(line, axis=0))
    # By the ball itself lengths grow by the ratio of the radii and no more.
    assert step.max() < 1.1 * (RADIUS + GAP) / 0.06
    assert step.min() > 0.5


def test_strands_are_pushed_out_but_for_their_roots(ball):
    strands = around(120, 0.05, 0.12).reshape(12, 10, 3)
    out = push_out_strands(ball, strands, GAP)
    assert np.array_equal(out[:, 0], strands[:, 0])
    slow = push_out_points(ball, strands[:, 1:].reshape(-1, 3), GAP)
    assert np.allclose(out[:, 1:].reshape(-1, 3), slow, atol=1e-12)
    assert lengths(strands[:, 1:]).min() < RADIUS < lengths(out[:, 1:]).min()
    same = push_out_strands(ball, np.asarray(strands), GAP)
    assert np.array_equal(same, out)


def test_strands_outside_come_back_as_they_are(ball):
    strands = around(40, 0.12, 0.2).reshape(4, 10, 3)
    assert np.array_equal(push_out_strands(ball, strands, GAP), strands)
    none = jnp.zeros((0, 10, 3))
    assert push_out_strands(ball, none, GAP).shape == (0, 10, 3)


def test_single_precision_does(ball):
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), ball)
    p = around(300, 0.05, 0.1)
    for field in (ball, single):
        out = push_out_points(field, p.astype(jnp.float32), GAP)
        assert out.dtype == jnp.float32
        assert np.allclose(out, push_out_points(ball, p, GAP), atol=1e-6)
    strands = p.astype(jnp.float32).reshape(30, 10, 3)
    assert push_out_strands(single, strands, GAP).dtype == jnp.float32


def test_skeletons_are_pushed_out_but_for_their_roots(ball, dome, make_tree):
    tree = make_tree(dome, [(0.5, 0.5, 0.3), (0.4, 0.5, 0.1)], [-1, 0])
    low = tree.cylinder.skeleton.at[:, 1:3].mul(0.4)
    one = jnp.ones((2, 2))
    maps = ScalpMaps(one, one, one, jnp.ones((2, 2, 3)), one)
    wisps = Wisps(jnp.full((1, 2), 0.4), jnp.array([1]), jnp.ones((1, 6, 3)))
    tree = eqx.tree_at(
        lambda t: (t.cylinder.skeleton, t.wisps, t.maps),
        tree,
        (low, wisps, maps),
        is_leaf=lambda x: x is None,
    )
    out = push_out_tree(ball, tree, GAP)
    assert np.array_equal(out.cylinder.skeleton[:, 0], low[:, 0])
    assert lengths(low[:, 1:3]).max() < RADIUS
    assert lengths(out.cylinder.skeleton[:, 1:]).min() > RADIUS
    back = eqx.tree_at(lambda t: t.cylinder.skeleton, out, low)
    assert eqx.tree_equal(back, tree)


def test_gradients_are_right_and_finite_where_they_may_break(ball):
    push = jax.jit(lambda p: push_out_points(ball, p, GAP))
    # Deep, shallow, above the gap, and outside the grid.
    p = jnp.array([[0.01, 0.031, 0.023], [0.05, 0.05, 0.03], [0.001, 0.083, 0.01]])
    p = jnp.concatenate([p, jnp.array([[0.3, 0.0, 0.0]])])
    check_grads(push, (p,), order=1, eps=1e-7)
    # The middle, the skin, a point of the grid and its last one.
    p = jnp.array([[0.0, 0.0, 0.0], [RADIUS, 0.0, 0.0], [0.02, 0.04, 0.0], [0.1] * 3])
    assert np.isfinite(jax.vjp(push, p)[1](jnp.ones((4, 3)))[0]).all()


def test_fields_without_room_are_refused():
    with pytest.raises(ValueError, match=r"at least 2 points .* got the shape"):
        DistanceField(jnp.zeros(3), jnp.array(0.1), jnp.zeros((2, 1, 2)))
    with pytest.raises(ValueError, match="a positive cell and a box"):
        sample_field(ball_distance, -SIDE, SIDE, 0.0)
    with pytest.raises(ValueError, match="a positive cell and a box"):
        sample_field(ball_distance, SIDE, -SIDE, CELL)
