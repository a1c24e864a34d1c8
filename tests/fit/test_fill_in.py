import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import comb, dome, meridian

from hairfit.errors import InputError
from hairfit.evaluate import score
from hairfit.fit.density import density_maps
from hairfit.fit.fill_in import fill_in
from hairfit.fit.root_scalp import root_places, scalp_points
from hairfit.fit.treeify import TreeifyConfig, treeify
from hairfit.model import find_owner, sample_strands
from hairfit.types import Strands

HOLE = meridian(0.8, 0.4)
RADIUS = 0.012
COUNT = 1500


def far(points):
    return np.linalg.norm(points - HOLE, axis=1) > RADIUS


@pytest.fixture(scope="module")
def groom():
    """Hair combed down a ball, and the tree of it but for a hole."""
    scalp = dome()
    rng = np.random.default_rng(0)
    roots = scalp_points(scalp, rng.uniform(0.15, 0.85, (COUNT, 2)))
    hair = comb(roots)
    config = TreeifyConfig(leaves=60, wisps=0, knots=12)
    return hair, treeify(Strands.from_array(hair[far(roots)]), scalp, config)


def grow(tree, count=COUNT):
    return np.asarray(sample_strands(tree, count, 24, jax.random.key(0)))


def test_hair_grows_in_a_hole_as_densely_as_around_it(groom):
    hair, found = groom
    bare, full = grow(found.tree), grow(fill_in(found.tree, found.uv, 0.015))
    inner = [
        np.linalg.norm(x[:, 0] - HOLE, axis=1) < 0.6 * RADIUS for x in (bare, full)
    ]
    truth = np.linalg.norm(hair[:, 0] - HOLE, axis=1) < 0.6 * RADIUS
    assert inner[0].sum() < 0.2 * truth.sum()
    assert 0.6 * truth.sum() < inner[1].sum() < 1.5 * truth.sum()


def test_hair_in_a_hole_runs_like_the_hair_that_was_there(groom):
    hair, found = groom
    full = grow(fill_in(found.tree, found.uv, 0.015), 4 * COUNT)
    mine = full[~far(full[:, 0])]
    there = Strands.from_array(comb(mine[:, 0]))
    (found_f,) = score(Strands.from_array(mine), there, ((0.003, 20.0),))
    assert found_f.unsigned.f > 0.9
    assert len(hair) == COUNT


def test_every_new_place_has_an_owner_and_others_keep_theirs(groom):
    _, found = groom
    full = fill_in(found.tree, found.uv, 0.015)
    side = HOLE + np.random.default_rng(1).normal(0.0, 0.2 * RADIUS, (200, 3))
    uv = root_places(found.tree.scalp, side)
    assert (np.asarray(find_owner(full, uv)) >= 0).all()
    before, after = (np.asarray(find_owner(t, found.uv)) for t in (found.tree, full))
    assert (before == after).mean() > 0.98


def test_a_groom_without_gaps_stays_as_it_is(groom):
    _, found = groom
    full = fill_in(found.tree, found.uv, 1e-4)
    for mine, other in zip(
        jax.tree.leaves(full), jax.tree.leaves(found.tree), strict=True
    ):
        assert np.array_equal(mine, other)


def test_few_strands_become_hair_that_is_closer_to_the_groom_than_they_are():
    scalp = dome()
    rng = np.random.default_rng(2)
    hair = comb(scalp_points(scalp, rng.uniform(0.15, 0.85, (2000, 2))))
    few = Strands.from_array(hair[:100].astype(np.float32))
    found = treeify(few, scalp, TreeifyConfig(leaves=20, wisps=0, knots=12))
    limits = ((0.002, 20.0),)
    truth = Strands.from_array(hair)
    (sparse,) = score(few, truth, limits)
    (dense,) = score(Strands.from_array(grow(found.tree, 2000)), truth, limits)
    assert dense.unsigned.f > sparse.unsigned.f + 0.15


@pytest.mark.parametrize("gap", [0.0, -1.0, np.nan])
def test_gaps_of_no_width_are_refused(groom, gap):
    with pytest.raises(InputError, match="wider than 0 m"):
        fill_in(groom[1].tree, groom[1].uv, gap)


def test_a_tree_without_density_is_refused(groom):
    bald = eqx.tree_at(lambda t: t.maps, groom[1].tree, None)
    with pytest.raises(InputError, match="no map of the hair's density"):
        fill_in(bald, groom[1].uv)
    assert jnp.all(density_maps(bald.scalp, groom[1].uv).density >= 0.0)
