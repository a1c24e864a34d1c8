import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import RADIUS, dome, hull_where

from hairfit.fit.prune import lost_share, prune
from hairfit.fit.samples import Samples
from hairfit.model import HairTree, ScalpContour, find_owner, plant, sample_roots
from hairfit.model.tree import take

CENTRES = [[0.3, 0.5], [0.7, 0.5], [0.25, 0.5], [0.4, 0.5], [0.6, 0.5], [0.75, 0.5]]
PARENT = (-1, -1, 0, 0, 1, 1)
REACH = RADIUS + 0.06  # strands of 5 cm end inside it, strands of 20 cm do not


@pytest.fixture(scope="module")
def scalp():
    return dome()


@pytest.fixture(scope="module")
def hull():
    return hull_where(
        lambda p: np.linalg.norm(p, axis=1) < REACH,
        [-REACH - 0.02] * 3,
        [REACH + 0.02] * 3,
        0.005,
    )


def tree_of(scalp, lengths):
    """Return two root clusters with two leaves each, of the given lengths."""
    contour = jax.vmap(ScalpContour)(
        jnp.array(CENTRES),
        jnp.array([0.2, 0.2, 0.12, 0.12, 0.12, 0.12]),
        jnp.zeros((6, 32)),
    )
    planted = jax.vmap(lambda c, n: plant(scalp, c, n, 8))(contour, jnp.array(lengths))
    return HairTree(scalp, contour, planted, jnp.zeros(6), PARENT)


@pytest.fixture(scope="module")
def uv(scalp):
    return np.asarray(sample_roots(scalp, 1200, jax.random.key(0)))


def samples_of(tree, uv):
    owner = np.asarray(find_owner(tree, uv))
    return Samples(jnp.asarray(uv[owner >= 0]), jnp.asarray(owner[owner >= 0]))


def test_a_leaf_that_leaves_the_hull_goes(scalp, uv, hull):
    tree = tree_of(scalp, [0.05, 0.05, 0.05, 0.2, 0.05, 0.05])
    found = prune(tree, samples_of(tree, uv), hull)
    assert found.parent == (-1, -1, 0, 1, 1)
    kept = [0, 1, 2, 4, 5]
    assert np.array_equal(found.contour.centre, np.array(CENTRES)[kept])
    assert np.array_equal(
        found.cylinder.skeleton, tree.cylinder.skeleton[jnp.array(kept)]
    )


def test_the_roots_of_a_leaf_that_went_are_its_siblings(scalp, uv, hull):
    tree = tree_of(scalp, [0.05, 0.05, 0.05, 0.2, 0.05, 0.05])
    before = np.asarray(find_owner(tree, uv))
    after = np.asarray(find_owner(prune(tree, samples_of(tree, uv), hull), uv))
    assert np.array_equal(after >= 0, before >= 0)
    assert (after[before == 3] == 2).all()


def test_a_root_cluster_keeps_its_best_leaf(scalp, uv, hull):
    tree = tree_of(scalp, [0.05, 0.05, 0.3, 0.15, 0.05, 0.05])
    found = prune(tree, samples_of(tree, uv), hull)
    assert found.parent == (-1, -1, 0, 1, 1)
    assert np.array_equal(found.contour.centre[2], CENTRES[3])


def test_a_tree_in_the_hull_stays_whole(scalp, uv, hull):
    tree = tree_of(scalp, [0.2, 0.2, 0.05, 0.05, 0.05, 0.05])
    samples = samples_of(tree, uv)
    found = prune(tree, samples, hull)
    assert found.parent == tree.parent
    assert (lost_share(tree, samples, hull) == 0).all()


def test_the_lost_share_is_that_of_points_beyond_the_hull(scalp, uv, hull):
    tree = tree_of(scalp, [0.05, 0.05, 0.05, 0.12, 0.2, 0.05])
    # Strands as straight as their clusters' middle: what is beyond is known.
    thin = eqx.tree_at(
        lambda t: (t.cylinder.radius, t.cylinder.offset),
        tree,
        (
            jnp.zeros_like(tree.cylinder.radius),
            jnp.zeros_like(tree.cylinder.offset),
        ),
    )
    lost = lost_share(thin, samples_of(tree, uv), hull)
    for leaf, length in ((3, 0.12), (4, 0.2)):
        expected = 1 - (REACH + 0.006 - RADIUS) / length
        assert np.isclose(lost[leaf], expected, atol=2 / 24)
    assert (lost[[0, 1, 2, 5]] == 0).all()


def test_beyond_the_grid_all_is_lost(scalp, uv):
    tree = tree_of(scalp, [0.05] * 6)
    far = hull_where(lambda p: p[:, 0] > 0, [5.0] * 3, [5.1] * 3, 0.02)
    lost = lost_share(tree, samples_of(tree, uv), far)
    assert np.allclose(lost[2:], 1.0)
    kept = prune(tree, samples_of(tree, uv), far)
    assert kept.parent == (-1, -1, 0, 1)


def test_taking_clusters_renumbers_their_parents(scalp):
    tree = tree_of(scalp, [0.05] * 6)
    found = take(tree, np.array([False, True, False, False, True, True]))
    assert found.parent == (-1, 0, 0)
    assert np.array_equal(found.contour.centre, np.array(CENTRES)[[1, 4, 5]])
    assert take(tree, np.ones(6, bool)).parent == tree.parent
