import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit.model import (
    Wisps,
    cluster,
    cylinder_point,
    descendants,
    grow_strands,
)
from hairfit.model.bind import bind_points, follow, update_points
from hairfit.model.edit import Binding, Grip, edit_cluster, edit_each
from hairfit.model.section import rotation

# Root clusters 0 and 1; 2 and 3 below 0; 4 below 2; 5 below 1.
CIRCLES = [
    (0.35, 0.5, 0.2),
    (0.75, 0.5, 0.2),
    (0.3, 0.5, 0.1),
    (0.42, 0.5, 0.1),
    (0.3, 0.48, 0.05),
    (0.75, 0.52, 0.1),
]
PARENT = (-1, -1, 0, 0, 2, 1)
KNOTS = 6


@pytest.fixture
def tree(flat, make_tree):
    made = make_tree(flat, CIRCLES, PARENT, knots=KNOTS, seed=1)
    wisps = Wisps(
        jnp.array([[0.3, 0.5], [0.75, 0.52]]),
        jnp.array([4, 5]),
        0.001 * jnp.ones((2, KNOTS, 3)),
    )
    return dataclasses.replace(made, wisps=wisps)


def same(a, b, index) -> bool:
    pairs = zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True)
    return all(bool(jnp.array_equal(x[index], y[index])) for x, y in pairs)


def turned_about_root(cylinder, turn):
    root = cylinder.skeleton[:1]
    return eqx.tree_at(
        lambda c: (c.skeleton, c.normal),
        cylinder,
        (root + (cylinder.skeleton - root) @ turn.T, turn @ cylinder.normal),
    )


def test_an_edit_that_changes_nothing_changes_nothing(tree):
    edited = edit_cluster(tree, 0, cluster(tree.cylinder, 0))
    for got, want in zip(jax.tree.leaves(edited), jax.tree.leaves(tree), strict=True):
        assert jnp.allclose(got, want, atol=1e-9)
    assert edited.parent == tree.parent


def test_all_below_follow_and_nothing_else_moves(tree):
    turn = rotation(jnp.array([0.0, 0.0, 1.0]), jnp.array(0.7))
    edited = edit_cluster(tree, 0, turned_about_root(cluster(tree.cylinder, 0), turn))
    moved = [i for i in range(6) if not same(tree.cylinder, edited.cylinder, i)]
    assert moved == [0, *descendants(tree, 0).tolist()]
    assert same(tree.contour, edited.contour, slice(None))
    assert eqx.tree_equal(tree.wisps, edited.wisps)


def test_roots_stay_on_the_scalp(tree):
    turn = rotation(jnp.array([0.0, 0.0, 1.0]), jnp.array(0.7))
    edited = edit_cluster(tree, 0, turned_about_root(cluster(tree.cylinder, 0), turn))
    assert jnp.array_equal(edited.cylinder.skeleton[:, 0], tree.cylinder.skeleton[:, 0])


def test_a_rigid_motion_moves_the_strands_of_all_below_rigidly(tree):
    """Where the roots, which stay, have no part in the tangents."""
    turn = rotation(jnp.array([0.6, 0.0, 0.8]), jnp.array(1.1))
    cylinder = cluster(tree.cylinder, 0)
    root = cylinder.skeleton[:1]
    edited = edit_cluster(tree, 0, turned_about_root(cylinder, turn))
    uv = jnp.array([[0.3, 0.49], [0.31, 0.5], [0.42, 0.55]])
    owner, eta = jnp.array([4, 4, 3]), jnp.ones(3)
    at_knots = [
        np.asarray(grow_strands(t, uv, owner, eta, KNOTS))[:, 2:]
        for t in (tree, edited)
    ]
    want = np.asarray(root[None] + (at_knots[0] - root[None]) @ turn.T)
    assert np.allclose(at_knots[1], want, atol=1e-9)


def test_followers_are_bound_by_equation_4_4(tree):
    rng = np.random.default_rng(0)
    before = cluster(tree.cylinder, 0)
    after = eqx.tree_at(
        lambda c: (c.skeleton, c.twist, c.scale),
        before,
        (
            before.skeleton.at[1:].add(0.01 * jnp.asarray(rng.normal(size=(5, 3)))),
            before.twist + 0.5,
            1.3 * before.scale,
        ),
    )
    edited = edit_cluster(tree, 0, after)
    for index in (2, 3, 4):
        skeleton = tree.cylinder.skeleton[index]
        bound = bind_points(before, skeleton)
        clear = ~np.asarray(bound.ambiguous)
        clear[0] = False  # the root stays
        want = update_points(after, bound)
        assert clear.sum() >= 3
        assert jnp.allclose(edited.cylinder.skeleton[index][clear], want[clear])


def test_temporary_binding_lasts_as_long_as_it_is_given(tree):
    turn = rotation(jnp.array([0.0, 0.0, 1.0]), jnp.array(0.4))
    new = turned_about_root(cluster(tree.cylinder, 0), turn)
    edited = edit_cluster(tree, 0, new, {1: 0})
    # Cluster 1 has no ancestor in common; it comes with what is below it.
    assert not same(tree.cylinder, edited.cylinder, 1)
    assert not same(tree.cylinder, edited.cylinder, 5)
    free = edit_cluster(tree, 0, new)
    assert same(tree.cylinder, free.cylinder, 1)
    # What is bound elsewhere no longer follows its parent.
    edited = edit_cluster(tree, 0, new, {2: 1})
    assert same(tree.cylinder, edited.cylinder, 2)
    assert same(tree.cylinder, edited.cylinder, 4)
    assert not same(tree.cylinder, edited.cylinder, 3)


def test_local_binding_moves_the_chosen_control_points_only(tree):
    before = cluster(tree.cylinder, 0)
    new = eqx.tree_at(lambda c: c.twist, before, before.twist + 1.0)
    edited = edit_cluster(tree, 0, new, {1: Binding(0, (3, 4))})
    moved = jnp.any(edited.cylinder.skeleton[1] != tree.cylinder.skeleton[1], axis=1)
    assert moved.tolist() == [False, False, False, True, True, False]
    # What is below follows the cluster, not the binder.
    one = jax.tree.map(lambda leaf: leaf[5:6], tree.cylinder)
    held = jnp.zeros((1, KNOTS), bool).at[:, 0].set(True)
    was, now = cluster(tree.cylinder, 1), cluster(edited.cylinder, 1)
    want = follow(was, now, one, held=held)
    assert jnp.allclose(edited.cylinder.skeleton[5], want.skeleton[0], atol=1e-12)


@pytest.mark.slow
def test_edits_have_gradients(tree):
    def strands(skeleton, tree):
        new = eqx.tree_at(lambda c: c.skeleton, cluster(tree.cylinder, 0), skeleton)
        edited = edit_cluster(tree, 0, new)
        return edited.cylinder.skeleton[2:5], edited.cylinder.scale[2:5]

    skeleton = tree.cylinder.skeleton[0] + 0.003
    check_grads(
        lambda s: strands(s, tree), (skeleton,), order=1, modes=["rev"], eps=1e-7
    )


def test_several_clusters_are_edited_in_their_order(tree):
    def longer(cylinder):
        return eqx.tree_at(lambda c: c.skeleton, cylinder, 1.1 * cylinder.skeleton)

    both = edit_each(tree, [0, 2], longer)
    one = edit_each(edit_each(tree, 0, longer), 2, longer)
    assert same(both.cylinder, one.cylinder, slice(None))


def test_a_grip_falls_off_to_both_sides():
    assert Grip().weights(4).tolist() == [1, 1, 1, 1]
    assert Grip(knot=2, reach=2).weights(6).tolist() == [0, 0.5, 1, 0.5, 0, 0]


def test_what_cannot_be_edited_is_refused(tree):
    cylinder = cluster(tree.cylinder, 0)
    with pytest.raises(ValueError, match="no cluster 6; the tree has clusters 0 to 5"):
        edit_cluster(tree, 6, cylinder)
    short = eqx.tree_at(lambda c: c.skeleton, cylinder, cylinder.skeleton[:4])
    with pytest.raises(ValueError, match="has 4 knots and the tree 6; resample"):
        edit_cluster(tree, 0, short)
    with pytest.raises(ValueError, match="cluster 0 would follow itself; bind it"):
        edit_cluster(tree, 0, cylinder, {0: 4})
    with pytest.raises(ValueError, match="no cluster 9"):
        edit_cluster(tree, 0, cylinder, {1: 9})
    with pytest.raises(ValueError, match=r"control points \[7\]; they go from 0 to 5"):
        edit_cluster(tree, 0, cylinder, {1: Binding(0, (7,))})
    with pytest.raises(ValueError, match="reach of an edit is positive, got 0"):
        Grip(knot=1, reach=0).weights(4)
    with pytest.raises(ValueError, match="no control point 4; they go from 0 to 3"):
        Grip(knot=4).weights(4)


def test_strands_at_the_contour_follow_scale_and_twist(tree):
    """A point of a child's content goes nearly where it goes if bound itself."""
    before = cluster(tree.cylinder, 0)
    after = eqx.tree_at(
        lambda c: (c.twist, c.scale), before, (before.twist + 0.6, 0.5 * before.scale)
    )
    edited = edit_cluster(tree, 0, after)
    point = jax.jit(cylinder_point)
    for theta in (0.0, 2.0):
        p = point(cluster(tree.cylinder, 4), 0.05, theta, 0.6)
        bound = bind_points(before, p[None])
        want = update_points(after, bound)[0]
        got = point(cluster(edited.cylinder, 4), 0.05, theta, 0.6)
        assert not bound.ambiguous[0]
        assert jnp.linalg.norm(got - want) < 0.05 * jnp.linalg.norm(want - p)
