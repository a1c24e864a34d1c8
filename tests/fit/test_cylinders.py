import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import dome

from hairfit.fit.cylinders import Members, refine_cylinders
from hairfit.model import (
    HairTree,
    ScalpContour,
    find_owner,
    grow_strands,
    plant,
    sample_roots,
    scalp_tangents,
)

KNOTS = 10


def known_tree(bend=0.008):
    """Return root clusters that bend, narrow, widen, twist and shear."""
    scalp = dome()
    centre = [[0.3, 0.3], [0.7, 0.35], [0.5, 0.7]]
    contour = jax.vmap(ScalpContour)(
        jnp.array(centre), jnp.array([0.12, 0.1, 0.14]), jnp.zeros((3, 32))
    )
    planted = jax.vmap(lambda c: plant(scalp, c, 0.12, KNOTS))(contour)
    t = np.linspace(0.0, 1.0, KNOTS)
    rng = np.random.default_rng(0)
    side = np.cumsum(bend * rng.normal(size=(3, KNOTS, 3)) * t[None, :, None], axis=1)
    droop = -0.1 * t[:, None] ** 2 * np.array([0.0, 1.0, 0.0])
    scale = np.stack([1 - 0.4 * t, 1 + 0.3 * t], axis=1)
    cylinder = eqx.tree_at(
        lambda c: (c.skeleton, c.radius, c.offset, c.scale, c.twist, c.shear),
        planted,
        (
            planted.skeleton + jnp.asarray(side + droop),
            # As a fit has it: linear in scalp space, unlike the patch itself.
            jnp.tile((contour.radius * metric(scalp, contour))[:, None], (1, KNOTS)),
            jnp.zeros_like(planted.offset),
            planted.scale * scale[None],
            planted.twist + jnp.asarray(0.6 * t)[None],
            planted.shear + jnp.asarray(0.2 * t)[None],
        ),
    )
    return HairTree(scalp, contour, cylinder, jnp.zeros(3), (-1, -1, -1))


def metric(scalp, contour):
    tangents = jax.vmap(scalp_tangents, (None, 0))(scalp, contour.centre)
    area = jnp.linalg.norm(jnp.cross(tangents.u, tangents.v), axis=1)
    return jnp.sqrt(area)


def members_of(uv, owner, strands):
    return Members(jnp.asarray(uv), jnp.asarray(owner, jnp.int32), jnp.asarray(strands))


@pytest.fixture(scope="module")
def known():
    """Return a tree and strands that grow from it."""
    tree = known_tree()
    uv = np.asarray(sample_roots(tree.scalp, 900, jax.random.key(1)))
    owner = np.asarray(find_owner(tree, uv))
    uv, owner = uv[owner >= 0], owner[owner >= 0]
    assert np.bincount(owner).min() > 15
    ones = jnp.ones(len(uv))
    strands = grow_strands(tree, jnp.asarray(uv), jnp.asarray(owner), ones, KNOTS)
    return tree, uv, owner, np.asarray(strands)


def regrown(tree, uv, owner):
    whole = jnp.ones(len(uv))
    return np.asarray(
        grow_strands(tree, jnp.asarray(uv), jnp.asarray(owner), whole, KNOTS)
    )


def off_a_little(tree):
    """Return the tree with its cylinders moved and narrowed."""
    rng = np.random.default_rng(7)
    t = np.linspace(0.0, 1.0, KNOTS)[None, :, None]
    away = 0.004 * t * rng.normal(size=(3, 1, 3))
    return eqx.tree_at(
        lambda x: (
            x.cylinder.skeleton,
            x.cylinder.scale,
            x.cylinder.twist,
            x.cylinder.shear,
        ),
        tree,
        (
            tree.cylinder.skeleton + jnp.asarray(away),
            tree.cylinder.scale * 0.97,
            tree.cylinder.twist * 0.95,
            tree.cylinder.shear * 0.9,
        ),
    )


def median_start(tree, uv, owner, strands):
    """Return how far strands of the start are from the true ones, in the median."""
    apart = regrown(off_a_little(tree), uv, owner) - strands
    return np.median(np.linalg.norm(apart, axis=2))


def refined(tree, uv, owner, strands):
    """Return what least squares find from a start that is off a little."""
    return refine_cylinders(off_a_little(tree), members_of(uv, owner, strands), 10)


def with_stray(strands, owner):
    """Return the strands, one of which runs 8 cm away from its cluster."""
    stray = strands.copy()
    t = np.linspace(0.0, 1.0, KNOTS)[:, None]
    stray[np.flatnonzero(owner == 1)[3]] += 0.08 * t * np.array([1.0, 0.5, 0.0])
    return stray


@pytest.mark.slow
def test_strands_of_a_known_tree_are_recovered(known):
    tree, uv, owner, strands = known
    fitted = refined(tree, uv, owner, strands)
    apart = np.linalg.norm(regrown(fitted.tree, uv, owner) - strands, axis=2)
    assert median_start(tree, uv, owner, strands) > 0.0015
    assert np.median(apart) < 0.0003
    assert fitted.error < 0.0003
    assert np.isclose(fitted.error, np.median(apart[:, 1:]), atol=1e-4)


@pytest.mark.slow
def test_strands_between_the_given_ones_are_recovered_as_well(known):
    tree, uv, owner, strands = known
    given = np.resize(np.arange(0, len(uv), 2), len(uv))  # half of them, twice
    fitted = refined(tree, uv[given], owner[given], strands[given])
    apart = np.linalg.norm(regrown(fitted.tree, uv, owner) - strands, axis=2)
    assert np.median(apart[1::2]) < 0.0003


@pytest.mark.slow
def test_what_is_not_fitted_is_the_trees(known):
    tree, uv, owner, strands = known
    fitted = refined(tree, uv, owner, strands)
    assert fitted.tree.parent == tree.parent
    for name in ("centre", "radius", "offset"):
        mine, given = (getattr(t.contour, name) for t in (fitted.tree, tree))
        assert np.array_equal(mine, given)
    assert fitted.result


@pytest.mark.slow
def test_a_strand_that_runs_elsewhere_does_not_move_its_cluster(known):
    tree, uv, owner, strands = known
    clean = refined(tree, uv, owner, strands).tree
    stray = with_stray(strands, owner)
    found = refined(tree, uv, owner, stray).tree
    rest = (stray == strands).all(axis=(1, 2))
    moved = regrown(found, uv, owner) - regrown(clean, uv, owner)
    assert np.linalg.norm(moved[rest], axis=2).max() < 0.0005
    mean = np.abs(strands[owner == 1].mean(0) - stray[owner == 1].mean(0)).max()
    assert mean > 0.001  # a plain mean would have moved
