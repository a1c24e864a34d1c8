import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.errors import InputError
from hairfit.evaluate import score
from hairfit.fit.root_scalp import scalp_for
from hairfit.fit.treeify import TreeifyConfig, leaf_count, treeify
from hairfit.model import (
    children,
    grow_strands,
    leaves,
    sample_strands,
    scalp_point,
)
from hairfit.types import Strands

POINTS = 20
COUNT = 500


def fan(count=COUNT, seed=0):
    """Strands on a ball of 10 cm that fall to two sides and wave a little."""
    rng = np.random.default_rng(seed)
    out = rng.normal(size=(count, 3)) * [0.4, 0.0, 0.4] + [0.0, 1.0, 0.0]
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    along = np.linspace(0.0, 0.12, POINTS)[None, :, None]
    side = np.where(out[:, :1, None] > 0.0, 1.0, -1.0) * np.array([[[1.0, -0.4, 0.0]]])
    wave = np.sin(60.0 * along + 9.0 * out[:, :1, None]) * np.array([[[0.0, 0.0, 1.0]]])
    return 0.1 * out[:, None] + along * (out[:, None] + side) + 0.02 * along * wave


@pytest.fixture(scope="module")
def strands():
    return Strands.from_array(fan())


@pytest.fixture(scope="module")
def scalp(strands):
    return scalp_for(None, strands)


def regrown(found):
    uv, eta = jnp.asarray(found.uv), jnp.asarray(found.eta)
    owner = jnp.asarray(found.owner, jnp.int32)
    return np.asarray(grow_strands(found.tree, uv, owner, eta, POINTS))


def missed(found):
    return np.linalg.norm(regrown(found) - fan(), axis=2).mean()


def test_the_scalp_runs_through_the_roots(strands, scalp):
    found = treeify(strands, scalp, TreeifyConfig(leaves=12, wisps=0))
    on = jax.vmap(scalp_point, (None, 0))(scalp, jnp.asarray(found.uv))
    assert np.linalg.norm(on - fan()[:, 0], axis=1).max() < 0.001
    assert found.figures["root_distance_m"] < 0.0005


def test_more_clusters_come_closer_and_wisps_closer_still(strands, scalp):
    configs = [(3, 0), (12, 0), (40, 0), (12, 200)]
    found = [
        treeify(strands, scalp, TreeifyConfig(leaves=n, wisps=w)) for n, w in configs
    ]
    few, some, many, wisps = map(missed, found)
    assert few > 1.5 * some and some > 1.5 * many
    assert wisps < some
    assert found[3].tree.wisps is not None and found[2].tree.wisps is None


def test_every_strand_belongs_to_a_leaf_and_every_leaf_to_a_cluster(strands, scalp):
    tree, _, owner, _, _ = treeify(
        strands, scalp, TreeifyConfig(leaves=30, levels=3, wisps=0)
    )
    assert set(owner) <= set(leaves(tree).tolist())
    depth = [0] * tree.count
    for index, parent in enumerate(tree.parent):
        depth[index] = 0 if parent < 0 else depth[parent] + 1
    assert {depth[i] for i in set(owner)} == {2}
    assert 1 < len(children(tree, -1)) < 10


def test_the_same_seed_gives_the_same_tree(strands, scalp):
    config = TreeifyConfig(leaves=10, wisps=20)
    one, two = (treeify(strands, scalp, config).tree for _ in range(2))
    for mine, other in zip(jax.tree.leaves(one), jax.tree.leaves(two), strict=True):
        assert np.array_equal(mine, other)


def test_few_strands_get_few_leaves_and_many_get_500(strands):
    few = Strands.from_array(fan(3))
    assert leaf_count(strands, TreeifyConfig()) == COUNT // 5
    assert leaf_count(few, TreeifyConfig()) == 1
    assert leaf_count(Strands.from_array(fan(4000)), TreeifyConfig()) == 500
    assert leaf_count(few, TreeifyConfig(leaves=7)) == 7


def test_hair_of_new_roots_is_like_other_hair_of_the_same_groom(strands, scalp):
    found = treeify(strands, scalp, TreeifyConfig(leaves=40, wisps=100))
    anew = np.asarray(sample_strands(found.tree, COUNT, POINTS, jax.random.key(0)))
    limits = ((0.006, 20.0),)
    (new,) = score(Strands.from_array(anew), strands, limits)
    (other,) = score(Strands.from_array(fan(seed=1)), strands, limits)
    assert new.unsigned.f > other.unsigned.f - 0.02


@pytest.mark.slow
def test_least_squares_do_not_worsen_what_the_closed_form_found(strands, scalp):
    plain = treeify(strands, scalp, TreeifyConfig(leaves=6, wisps=0, steps=0))
    moved = treeify(strands, scalp, TreeifyConfig(leaves=6, wisps=0, steps=2))
    assert moved.figures["error_m"] <= plain.figures["error_m"]


@pytest.mark.parametrize(
    ("points", "config", "message"),
    [
        (np.zeros((0, 5, 3)), {}, "there is no strand"),
        (np.full((9, 5, 3), np.nan), {"leaves": 2}, "not finite numbers"),
        (np.ones((9, 5, 3)), {"leaves": 2}, "9 of 9 strands are single points"),
        (fan(9), {"leaves": 12}, "9 strands cannot fill 12 leaf clusters"),
        (fan(9), {"leaves": 0}, "at least 1 leaf"),
        (fan(9), {"leaves": 2, "knots": 3}, "4 knots"),
    ],
)
def test_what_makes_no_tree_is_refused(scalp, points, config, message):
    with pytest.raises(InputError, match=message):
        treeify(Strands.from_array(points), scalp, TreeifyConfig(**config))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 5, 3)), "there is no strand"),
        (np.full((9, 5, 3), np.nan), "not finite numbers"),
        (100.0 * fan(50), "scale the strands to metres"),
    ],
)
def test_roots_of_no_hair_are_refused(points, message):
    with pytest.raises(InputError, match=message):
        scalp_for(None, Strands.from_array(points))
