import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import comb, dome

from hairfit.fit.cluster import lay_clusters
from hairfit.model import contains, find_owner, leaves, sample_roots, scalp_point

STRANDS, ROOTS, LEAVES = 600, 8, 30


@pytest.fixture(scope="module")
def hair():
    scalp = dome()
    uv = np.asarray(sample_roots(scalp, STRANDS, jax.random.key(0)), np.float64)
    roots = np.asarray(jax.vmap(scalp_point, (None, 0))(scalp, jnp.asarray(uv)))
    return scalp, uv, comb(roots)


@pytest.fixture(scope="module")
def layout(hair):
    return lay_clusters(*hair, roots=ROOTS, leaves=LEAVES, seed=0)


def inside(contour, uv):
    return np.asarray(jax.vmap(contains)(contour, jnp.asarray(uv)))


def test_every_strand_has_an_owner_and_it_is_a_leaf(hair, layout):
    assert (layout.owner >= 0).all()
    assert np.isin(layout.owner, leaves(layout.tree)).all()
    assert np.array_equal(layout.owner, find_owner(layout.tree, hair[1]))


def test_there_are_two_levels_and_root_clusters_stand_first(layout):
    parent = np.asarray(layout.tree.parent)
    roots = int((parent < 0).sum())
    assert (parent[:roots] == -1).all()
    assert ((parent[roots:] >= 0) & (parent[roots:] < roots)).all()
    assert np.isin(np.arange(roots), parent).all()  # each has a leaf
    assert roots == ROOTS
    assert 0.8 * LEAVES <= len(parent) - roots <= 1.2 * LEAVES


def test_no_leaf_is_without_strands(layout):
    count = np.bincount(layout.owner, minlength=layout.tree.count)
    assert (count[leaves(layout.tree)] > 0).all()


def test_contours_contain_their_strands(hair, layout):
    _, uv, _ = hair
    tree = layout.tree
    leaf = jax.tree.map(lambda x: x[layout.owner], tree.contour)
    above = np.asarray(tree.parent)[layout.owner]
    root = jax.tree.map(lambda x: x[above], tree.contour)
    assert inside(root, uv).all()
    assert inside(leaf, uv).mean() > 0.97


def test_strands_that_run_two_ways_are_not_in_one_leaf(hair):
    # Left and right of a parting in the middle, one comb each way.
    scalp, uv, strands = hair
    side = np.where(uv[:, 0] < 0.5, -1.0, 1.0)
    away = np.linspace(0.0, 0.1, strands.shape[1])
    parted = strands[:, :1] + side[:, None, None] * away[None, :, None] * [1.0, 0, 0]
    layout = lay_clusters(scalp, uv, parted, roots=ROOTS, leaves=LEAVES, seed=0)
    share = np.bincount(layout.owner, side > 0) / np.bincount(layout.owner).clip(1)
    mixed = np.minimum(share, 1 - share) * np.bincount(layout.owner)
    assert mixed.sum() < 0.02 * STRANDS


def test_the_metric_is_metres_on_the_scalp_for_one_of_scalp_space(hair, layout):
    scalp, step = hair[0], 1e-4
    point = functools.partial(scalp_point, scalp)
    for index in (0, 5, 20):
        centre = layout.tree.contour.centre[index]
        du, dv = (
            (point(centre + step * one) - point(centre - step * one)) / (2 * step)
            for one in jnp.eye(2)
        )
        area = float(jnp.linalg.norm(jnp.cross(du, dv)))
        assert np.isclose(layout.metric[index], np.sqrt(area), rtol=1e-5)


def test_the_same_seed_gives_the_same_clusters(hair, layout):
    again = lay_clusters(*hair, roots=ROOTS, leaves=LEAVES, seed=0)
    assert again.tree.parent == layout.tree.parent
    assert np.array_equal(again.tree.contour.radius, layout.tree.contour.radius)
    other = lay_clusters(*hair, roots=ROOTS, leaves=LEAVES, seed=1)
    assert not np.array_equal(other.owner, layout.owner)


def test_fewer_strands_than_clusters_are_enough(hair):
    scalp, uv, strands = hair
    layout = lay_clusters(scalp, uv[:5], strands[:5], roots=8, leaves=30, seed=0)
    assert (layout.owner >= 0).all()
    assert layout.tree.count <= 10
