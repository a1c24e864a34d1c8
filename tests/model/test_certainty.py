import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.model import TreeConfidence, drop, drop_descendants, graft, take
from hairfit.model.certainty import UNKNOWN_ANGLE, UNKNOWN_POSITION

CIRCLES = [(0.3, 0.5, 0.2), (0.7, 0.5, 0.2), (0.3, 0.5, 0.1), (0.7, 0.5, 0.1)]


@pytest.fixture
def tree(flat, make_tree):
    """Two root clusters with a leaf each, every cluster with its own confidence."""
    number = jnp.arange(4.0)
    known = TreeConfidence(0.001 * (1 + number), 0.1 * (1 + number), 0.2 * number)
    grown = make_tree(flat, CIRCLES, (-1, -1, 0, 1))
    return dataclasses.replace(grown, confidence=known)


def test_the_chance_is_the_share_of_gaussian_errors_within_both_tolerances():
    rng = np.random.default_rng(0)
    sigma_p, sigma_a = 0.002, 0.3
    away = sigma_p * np.hypot(*rng.normal(size=(2, 200_000)))
    turned = sigma_a * np.hypot(*rng.normal(size=(2, 200_000)))
    share = np.mean((away < 0.003) & (turned < 0.5))
    known = TreeConfidence(jnp.array([sigma_p]), jnp.array([sigma_a]), jnp.ones(1))
    assert np.isclose(known.chance(0.003, 0.5)[0], share, atol=0.003)


def test_the_chance_falls_from_one_to_nothing_as_errors_grow():
    sigma = jnp.array([0.0, 0.001, 0.003, 0.01, 1e6])
    chance = np.asarray(TreeConfidence(sigma, 0.0 * sigma, sigma).chance(0.003, 0.5))
    assert chance[0] == 1.0 and np.isclose(chance[-1], 0.0, atol=1e-12)
    assert (np.diff(chance) < 0).all()


def test_clusters_that_stay_keep_their_confidence(tree):
    some = take(tree, np.array([False, True, False, True]))
    for mine, all_ in zip(
        jax.tree.leaves(some.confidence), jax.tree.leaves(tree.confidence), strict=True
    ):
        assert np.array_equal(mine, np.asarray(all_)[[1, 3]])
    for fewer, count in ((drop(tree, 0), 2), (drop_descendants(tree, 0), 3)):
        shapes = [leaf.shape for leaf in jax.tree.leaves(fewer.confidence)]
        assert shapes == [(count,)] * 3


def test_added_clusters_are_as_certain_as_what_they_belong_to(tree):
    rows = np.array([0, 1, 2])
    parts = tree.contour, tree.cylinder, tree.length_variation
    contour, cylinder, variation = jax.tree.map(lambda leaf: leaf[rows], parts)
    # One under cluster 3, one under that one, and one that belongs to none.
    grown = graft(tree, contour, cylinder, variation, [3, 4, -1])
    known = grown.confidence
    assert known is not None
    want = [0.001, 0.002, 0.003, 0.004, 0.004, 0.004, UNKNOWN_POSITION]
    assert np.allclose(known.sigma_position, want)
    assert np.isclose(known.sigma_angle[-1], UNKNOWN_ANGLE)
    assert np.allclose(known.photographed, [0.0, 0.2, 0.4, 0.6, 0.6, 0.6, 0.0])


def test_a_tree_without_confidence_gets_none_by_edits(flat, make_tree):
    tree = make_tree(flat, CIRCLES, (-1, -1, 0, 1))
    added = (tree.contour, tree.cylinder, tree.length_variation)
    assert graft(tree, *added, [-1] * 4).confidence is None
    assert take(tree, np.array([True, False, True, False])).confidence is None


def test_confidence_of_another_number_of_clusters_is_refused(tree):
    three = jax.tree.map(lambda leaf: leaf[:3], tree.confidence)
    with pytest.raises(ValueError, match="`confidence` of a tree of 4 clusters needs"):
        dataclasses.replace(tree, confidence=three)
