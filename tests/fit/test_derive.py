import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import RADIUS, ball, dome, meridian

from hairfit.capture.distance import Skin, signed_distance
from hairfit.errors import InputError
from hairfit.fit.derive import (
    DEEPEST,
    PIECES,
    SKIN_GAP,
    derive_strands,
    find_dives,
    last_outside,
)
from hairfit.model import HairTree, ScalpContour, plant, sample_strands

COUNT, POINTS = 150, 16


@pytest.fixture(scope="module")
def tree():
    """One cluster over all of the scalp; its strands rise by 5 cm and bend."""
    scalp = dome()
    contour = ScalpContour(jnp.full(2, 0.5), jnp.array(0.9), jnp.zeros(32))
    contours = jax.tree.map(lambda x: x[None], contour)
    planted = jax.tree.map(lambda x: x[None], plant(scalp, contour, 0.05, 8))
    return HairTree(scalp, contours, planted, jnp.zeros(1), (-1,))


def points_of(strands):
    return strands.points.astype(np.float64).reshape(-1, POINTS, 3)


def deepest(points, head):
    """Return how deep strands run in a head, between their points as well."""
    share = np.linspace(0.0, 1.0, 30)[:, None]
    start, end = points[:, :-1, None], points[:, 1:, None]
    dense = start * (1 - share) + end * share
    return -signed_distance(head, dense.reshape(-1, 3)).min()


def test_without_a_head_they_are_the_trees_own(tree):
    found = points_of(derive_strands(tree, None, COUNT, POINTS, 3))
    expected = sample_strands(tree, COUNT, POINTS, jax.random.key(3))
    assert np.allclose(found, expected, atol=1e-7)


def test_there_are_as_many_as_were_asked_for_and_none_runs_in_the_head(tree):
    head = ball()
    found = points_of(derive_strands(tree, head, COUNT, POINTS, 3))
    assert len(found) == COUNT
    assert deepest(found, head) < 0.001


def test_roots_under_the_skin_are_laid_onto_it(tree):
    larger = ball(1.02 * RADIUS)
    found = points_of(derive_strands(tree, larger, COUNT, POINTS, 3))
    assert len(found) == COUNT
    height = signed_distance(larger, found[:, 0])
    assert np.allclose(height, SKIN_GAP, atol=1e-5)
    assert deepest(found, larger) < 0.001


def test_strands_that_dive_into_the_head_end_there(tree):
    # Strands that turn back to the ball's middle.
    t = jnp.linspace(0.0, 1.0, 8)[None, :, None]
    skeleton = tree.cylinder.skeleton
    diving = skeleton + jnp.maximum(t - 0.4, 0.0) * jnp.array([[[0.0, -0.3, 0.0]]])
    folded = eqx.tree_at(lambda x: x.cylinder.skeleton, tree, diving)
    head = ball()
    free = points_of(derive_strands(folded, None, COUNT, POINTS, 3))
    assert deepest(free, head) > 0.02
    found = points_of(derive_strands(folded, head, COUNT, POINTS, 3))
    assert deepest(found, head) < 0.0015
    assert len(found) > 0


def test_the_same_seed_gives_the_same_strands_and_another_does_not(tree):
    one, same, other = (
        derive_strands(tree, ball(), COUNT, POINTS, seed).points for seed in (1, 1, 2)
    )
    assert np.array_equal(one, same) and not np.array_equal(one, other)


def test_a_tree_that_covers_nothing_is_refused(tree):
    nowhere = eqx.tree_at(
        lambda t: t.contour.radius, tree, jnp.full_like(tree.contour.radius, 1e-9)
    )
    with pytest.raises(InputError, match="no strand grows from the tree.*fit it again"):
        derive_strands(nowhere, None, COUNT, POINTS, 0)


def test_a_strand_is_outside_up_to_where_it_dives():
    head = ball()
    polar = np.linspace(0.5, 1.5, 11)
    along = meridian(polar, 0.3, 0.001)
    dives = along.copy()
    dives[7:] *= (RADIUS - 0.004) / np.linalg.norm(dives[7:], axis=1, keepdims=True)
    shallow = along * (RADIUS - 0.5 * DEEPEST) / np.linalg.norm(along[0])
    high = along * 1.2
    strands = np.stack([along, dives, shallow, high])
    # The chord of the first strand sinks by r (1 - cos 0.05) = 0.1 mm only.
    assert last_outside(strands, Skin(head)).tolist() == [10, 6, 10, 0]


def test_a_long_segment_through_the_head_is_seen_though_its_ends_are_outside():
    head = ball()
    root = np.array([0.0, RADIUS + 0.001, 0.0])
    through = np.stack([root, [0.02, 0.1, 0.0], [0.02, -0.1, 0.0]])
    assert last_outside(through[None], Skin(head)).tolist() == [1]
    assert last_outside(np.zeros((0, 5, 3)), Skin(head)).tolist() == []


def test_dives_are_those_that_looking_at_every_piece_finds():
    head = ball()
    rng = np.random.default_rng(0)
    strands = rng.normal(size=(40, 6, 3))
    far = RADIUS * rng.uniform(0.97, 1.2, (40, 6, 1))
    strands *= far / np.linalg.norm(strands, axis=2, keepdims=True)
    # Some segments are short and near the skin, others cut through the ball.
    strands[:20] = strands[:20, :1] + 0.05 * (strands[:20] - strands[:20, :1])
    found = find_dives(strands, Skin(head))
    share = np.arange(1, PIECES + 1)[:, None] / PIECES
    start, step = strands[:, :-1, None], np.diff(strands, axis=1)[:, :, None]
    every = start + share * step
    depth = signed_distance(head, every.reshape(-1, 3)).reshape(every.shape[:3])
    strand, segment = np.nonzero(depth.min(axis=2) < -DEEPEST)
    assert 10 < len(strand) < 190
    assert np.array_equal(found.strand, strand)
    assert np.array_equal(found.segment, segment)
    deepest_one = every[strand, segment, depth[strand, segment].argmin(axis=1)]
    assert np.allclose(found.spot, deepest_one, atol=1e-12)
