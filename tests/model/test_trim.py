import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.model import Wisps, arc_length, cluster, cylinder_knots, cylinder_point
from hairfit.model.edit import Plane
from hairfit.model.trim import cut, lengthen

CIRCLES = [(0.4, 0.5, 0.2), (0.7, 0.5, 0.1), (0.4, 0.5, 0.1)]
PARENT = (-1, -1, 0)
KNOTS = 8
at_knots = jax.jit(cylinder_knots)
at_point = jax.jit(jax.vmap(cylinder_point, (None, None, None, 0)))


@pytest.fixture
def tree(flat, make_tree):
    made = make_tree(flat, CIRCLES, PARENT, knots=KNOTS, seed=2)
    along = jnp.linspace(0.0, 0.2, KNOTS)[None, :, None] * jnp.eye(3)[1][None, None]
    straight = made.cylinder.skeleton[:, :1] + along
    gentle = straight + 0.2 * (made.cylinder.skeleton - straight)
    made = eqx.tree_at(lambda t: t.cylinder.skeleton, made, gentle)
    offset = 0.001 * jnp.arange(2.0 * KNOTS * 3).reshape(2, KNOTS, 3)
    wisps = Wisps(jnp.array([[0.4, 0.5], [0.7, 0.5]]), jnp.array([2, 1]), offset)
    return dataclasses.replace(made, wisps=wisps)


def length(tree, index):
    return float(arc_length(tree.cylinder.skeleton[index])[-1])


def test_a_cut_cluster_is_the_begin_of_what_it_was(tree):
    short = cut(tree, 1, 0.5)
    t = jnp.linspace(0.0, 0.5, KNOTS)
    for theta in (0.0, 2.0):
        want = at_point(cluster(tree.cylinder, 1), 0.1, theta, t)
        got = at_knots(cluster(short.cylinder, 1), 0.1, theta)
        # The tangents of the new knots differ a little from the interpolated ones.
        assert jnp.max(jnp.linalg.norm(got - want, axis=1)) < 1e-3
    middle = at_point(cluster(tree.cylinder, 1), 0.0, 0.0, t)
    assert jnp.allclose(short.cylinder.skeleton[1], middle, atol=1e-12)


def test_clusters_below_are_cut_where_they_pass_the_cut(tree):
    short = cut(tree, 0, 0.6)
    assert length(short, 2) < 0.85 * length(tree, 2)
    tip = short.cylinder.skeleton[2, -1]
    at = at_point(cluster(tree.cylinder, 0), 0.0, 0.0, jnp.array([0.6]))[0]
    tangent = at_point(cluster(tree.cylinder, 0), 0.0, 0.0, jnp.array([0.61]))[0] - at
    beyond = jnp.dot(tip - at, tangent / jnp.linalg.norm(tangent))
    assert jnp.abs(beyond) < 2e-3
    assert jnp.array_equal(short.cylinder.skeleton[1], tree.cylinder.skeleton[1])


def test_a_plane_cuts_all_at_one_height(tree):
    plane = Plane((0.0, 0.1, 0.0), (0.0, 2.0, 0.0))
    short = cut(tree, [0, 1], plane)
    assert jnp.allclose(short.cylinder.skeleton[:, -1, 1], 0.1, atol=1e-4)
    high = Plane((0.0, 1.0, 0.0), (0.0, 1.0, 0.0))
    same = cut(tree, 0, high)
    assert jnp.allclose(same.cylinder.skeleton, tree.cylinder.skeleton, atol=1e-9)
    below = Plane((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))  # even roots are behind it
    same = cut(tree, 0, below)
    assert jnp.allclose(same.cylinder.skeleton, tree.cylinder.skeleton, atol=1e-9)


def test_hair_grows_on_along_its_tip(tree):
    long = lengthen(tree, 0, 1.5)
    for index in (0, 2):
        assert abs(length(long, index) / length(tree, index) - 1.5) < 0.02
    tip = tree.cylinder.skeleton[0, -1] - tree.cylinder.skeleton[0, -2]
    rest = long.cylinder.skeleton[0, -1] - tree.cylinder.skeleton[0, -1]
    cos = jnp.dot(tip, rest) / jnp.linalg.norm(tip) / jnp.linalg.norm(rest)
    assert jnp.allclose(cos, 1.0, atol=1e-12)
    short = lengthen(tree, 0, 0.5)
    assert abs(length(short, 2) / length(tree, 2) - 0.5) < 0.02


def test_stretched_hair_keeps_its_form(tree):
    long = lengthen(tree, 0, 1.5, stretch=True)
    root = tree.cylinder.skeleton[0, :1]
    want = root + 1.5 * (tree.cylinder.skeleton[0] - root)
    assert jnp.allclose(long.cylinder.skeleton[0], want, atol=1e-12)
    assert 1.3 < length(long, 2) / length(tree, 2) < 1.7


def test_wisps_end_where_their_cluster_ends(tree):
    before, after = tree.wisps, cut(tree, 1, 0.5).wisps
    assert before is not None and after is not None
    assert jnp.array_equal(after.offset[0], before.offset[0])
    t = 0.5 * jnp.linspace(0.0, 1.0, KNOTS)
    knots = np.linspace(0.0, 1.0, KNOTS)
    want = [np.interp(t, knots, x) for x in np.asarray(before.offset[1]).T]
    assert jnp.allclose(after.offset[1], jnp.asarray(np.stack(want, 1)))


def test_a_cut_has_gradients(tree):
    def tip(t):
        return cut(tree, 1, t).cylinder.skeleton[1, -1]

    slope = jax.jacfwd(tip)(0.5)
    ends = at_point(cluster(tree.cylinder, 1), 0.0, 0.0, jnp.array([0.4999, 0.5001]))
    assert jnp.allclose(slope, (ends[1] - ends[0]) / 2e-4, rtol=1e-3, atol=1e-4)

    def by_plane(skeleton):
        some = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton)
        plane = Plane((0.0, 0.1, 0.0), (0.0, 1.0, 0.0))
        return jnp.sum(cut(some, 0, plane).cylinder.skeleton ** 2)

    slopes = jax.grad(by_plane)(tree.cylinder.skeleton)
    assert jnp.all(jnp.isfinite(slopes))
