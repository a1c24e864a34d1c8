import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import dome

from hairfit.fit.samples import Samples, grow_placed, place, sampled_strands
from hairfit.model import HairTree, ScalpContour, find_owner, grow_strands, plant
from hairfit.model import sample_roots as roots_on
from hairfit.model.tree import Clusters

KNOTS, POINTS, STRANDS = 7, 19, 60


@pytest.fixture(scope="module")
def tree():
    """Two clusters and a leaf, bent, twisted and sheared, of uneven sections."""
    contour = jax.vmap(ScalpContour)(
        jnp.array([[0.35, 0.4], [0.65, 0.6], [0.6, 0.6]]),
        jnp.array([0.3, 0.3, 0.2]),
        0.02 * jax.random.normal(jax.random.key(1), (3, 32)),
    )
    planted = jax.vmap(lambda c: plant(dome(), c, 0.1, KNOTS))(contour)
    return HairTree(dome(), contour, changed(planted, 2), jnp.zeros(3), (-1, -1, 1))


@pytest.fixture(scope="module")
def samples(tree):
    uv = roots_on(tree.scalp, 4 * STRANDS, jax.random.key(3))
    owner = np.asarray(find_owner(tree, uv))
    held = np.resize(np.flatnonzero(owner >= 0), STRANDS)
    return Samples(uv[held], jnp.asarray(owner[held]))


def changed(cylinder, seed):
    """Return clusters after any move that a refinement can make."""
    keys = jax.random.split(jax.random.key(seed), 4)
    return eqx.tree_at(
        lambda c: (c.skeleton, c.scale, c.twist, c.shear),
        cylinder,
        tuple(
            leaf + size * jax.random.normal(key, leaf.shape)
            for leaf, size, key in zip(
                (cylinder.skeleton, cylinder.scale, cylinder.twist, cylinder.shear),
                (0.004, 0.1, 0.3, 0.1),
                keys,
                strict=True,
            )
        ),
    )


def grown(tree, samples):
    uv, owner = samples
    return grow_strands(tree, uv, owner, jnp.ones(STRANDS), POINTS)


def test_placed_strands_grow_as_those_of_the_tree(tree, samples):
    assert np.allclose(
        sampled_strands(tree, samples, POINTS), grown(tree, samples), atol=1e-12
    )


def test_strands_that_were_placed_follow_clusters_that_move(tree, samples):
    placed = place(tree.scalp, Clusters(tree.contour, tree.cylinder), samples)
    after = eqx.tree_at(lambda t: t.cylinder, tree, changed(tree.cylinder, 5))
    found = grow_placed(after.cylinder, placed, POINTS)
    assert np.abs(np.asarray(found - grown(tree, samples))).max() > 0.005
    assert np.allclose(found, grown(after, samples), atol=1e-12)


def test_gradients_are_those_of_the_trees_strands(tree, samples):
    placed = place(tree.scalp, Clusters(tree.contour, tree.cylinder), samples)
    towards = jax.random.normal(jax.random.key(7), (STRANDS, POINTS, 3))

    def moves(cylinder):
        return cylinder.skeleton, cylinder.scale, cylinder.twist, cylinder.shear

    def placed_loss(parts):
        cylinder = eqx.tree_at(moves, tree.cylinder, parts)
        return jnp.sum(towards * grow_placed(cylinder, placed, POINTS))

    def tree_loss(parts):
        cylinder = eqx.tree_at(moves, tree.cylinder, parts)
        after = eqx.tree_at(lambda t: t.cylinder, tree, cylinder)
        return jnp.sum(towards * grown(after, samples))

    found = jax.grad(placed_loss)(moves(tree.cylinder))
    wanted = jax.grad(tree_loss)(moves(tree.cylinder))
    for mine, other in zip(found, wanted, strict=True):
        assert np.abs(np.asarray(other)).max() > 1e-3
        assert np.allclose(mine, other, atol=1e-10)


def test_room_for_more_clusters_changes_nothing(tree, samples):
    plain = sampled_strands(tree, samples, POINTS)
    assert np.array_equal(sampled_strands(tree, samples, POINTS, room=9), plain)
