import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import RADIUS, comb, dome

from hairfit.fit.gather import Rooted
from hairfit.fit.treeify import TreeifyConfig, on_scalp, treeify
from hairfit.fit.wisps import add_wisps, choose_wisps, shared_out, wisp_residuals
from hairfit.model import grow_strands, leaves
from hairfit.types import Strands

KNOTS, COUNT = 12, 150


@pytest.fixture(scope="module")
def ball():
    """A tree of three leaves, the strands it was made from, and their owners."""
    scalp = dome()
    rng = np.random.default_rng(0)
    uv = rng.uniform(0.2, 0.8, (COUNT, 2))
    knots = comb(np.asarray(on_scalp(scalp, jnp.asarray(uv)).point))
    turn = 0.004 * np.linspace(0.0, 1.0, KNOTS)[:, None]
    knots += turn * rng.normal(size=(COUNT, 1, 3))  # each for itself
    config = TreeifyConfig(leaves=3, levels=1, knots=KNOTS, wisps=0)
    found = treeify(Strands.from_array(knots), scalp, config)
    point, ground = on_scalp(scalp, jnp.asarray(found.uv))
    knots[:, 0] = point
    return found.tree, Rooted(found.uv, knots, np.asarray(ground)), found.owner


def grown(tree, rooted, owner):
    whole = jnp.ones(len(owner))
    uv = jnp.asarray(rooted.uv)
    return np.asarray(grow_strands(tree, uv, jnp.asarray(owner, jnp.int32), whole, 40))


def squares(tree, rooted, owner):
    return (wisp_residuals(tree, rooted, owner)[:, 1:] ** 2).sum()


def test_what_strands_do_beside_their_clusters_is_what_wisps_hold(ball):
    tree, rooted, owner = ball
    every = add_wisps(tree, rooted, owner, 100 * COUNT, seed=0)
    assert every.wisps is not None and len(every.wisps.owner) == COUNT
    hair = grown(every, rooted, owner)
    curve = jax.vmap(lambda knots: jnp.asarray(knots)[-1])(jnp.asarray(rooted.knots))
    assert np.abs(hair[:, -1] - np.asarray(curve)).max() < 1e-9
    assert np.abs(hair[:, 0] - rooted.knots[:, 0]).max() < 1e-9


def test_few_wisps_come_closer_than_none_and_more_closer_still(ball):
    tree, rooted, owner = ball
    missed = []
    for count in (0, 15, 75):
        some = add_wisps(tree, rooted, owner, count, seed=0) if count else tree
        tips = grown(some, rooted, owner)[:, -1] - rooted.knots[:, -1]
        missed.append((tips**2).sum())
    assert missed[0] > missed[1] > 1.5 * missed[2]


def test_a_wisp_says_a_strand_in_the_middle_of_those_that_follow_it(ball):
    tree, rooted, owner = ball
    rest = wisp_residuals(tree, rooted, owner)
    rest[:, 0] = 0.0
    leaf = int(owner[0])
    mine = owner == leaf
    alone = Rooted(*(rows[mine] for rows in rooted))
    one = add_wisps(tree, alone, owner[mine], 1, seed=0).wisps
    assert one is not None and one.owner.tolist() == [leaf]
    away = ((rest[mine] - rest[mine].mean(axis=0)) ** 2).sum(axis=(1, 2))
    said = ((rest[mine] - np.asarray(one.offset)) ** 2).sum(axis=(1, 2))
    assert said.min() < 1e-20 and said.argmin() == away.argmin()


def test_wisps_are_shared_out_by_the_largest_remainders():
    weight = np.array([5.0, 0.0, 3.3, 1.7])
    assert shared_out(10, weight).tolist() == [5, 0, 3, 2]
    assert shared_out(3, weight).tolist() == [1, 0, 1, 1]
    assert shared_out(3, 0.0 * weight).tolist() == [0, 0, 0, 0]


def test_wisps_go_to_the_leaves_that_miss_most(ball):
    tree, rooted, owner = ball
    rest = wisp_residuals(tree, rooted, owner)
    worst = int(leaves(tree)[0])
    rest[owner == worst] *= 10.0
    chosen = choose_wisps(tree, rooted.uv, owner, rest, 20, seed=0)
    assert (owner[chosen] == worst).mean() > 0.9
    assert (np.diff(chosen) > 0).all()


def test_no_residual_is_left_of_strands_that_the_tree_grew(ball):
    tree, rooted, owner = ball
    whole = jnp.ones(COUNT)
    uv, of = jnp.asarray(rooted.uv), jnp.asarray(owner, jnp.int32)
    # Points at the knots: the curve between them runs through its knots.
    fine = np.asarray(grow_strands(tree, uv, of, whole, KNOTS))
    again = rooted._replace(knots=fine)
    assert squares(tree, again, owner) < 0.05 * squares(tree, rooted, owner)


def test_wisps_of_strands_that_are_met_exactly_are_none(ball):
    tree, rooted, owner = ball
    still = eqx.tree_at(lambda t: t.length_variation, tree, 0.0 * tree.length_variation)
    rest = np.zeros((COUNT, KNOTS, 3))
    assert len(choose_wisps(still, rooted.uv, owner, rest, 50, seed=0)) == 0
    assert np.linalg.norm(rooted.knots[:, 0], axis=1) == pytest.approx(RADIUS, rel=0.05)
