import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import RADIUS, dome, hull_where, no_hair

from hairfit.fit.density import TEXELS
from hairfit.fit.tips import SHORTEST, share_inside, with_tips_inside
from hairfit.model import HairTree, ScalpContour, plant
from hairfit.model.maps import even_maps
from hairfit.model.strand import Hair, sample_hair

SPACING = 0.005
EVEN = even_maps(TEXELS, TEXELS)
REACH = RADIUS + 0.06  # strands of 5 cm end inside it, strands of 20 cm do not


def slab(top):
    """Return a hull of all that is between y = -4 cm and `top`, wide along x and z."""
    return hull_where(
        lambda p: (
            (p[:, 1] > -0.04) & (p[:, 1] < top) & (np.abs(p[:, ::2]) < 0.1).all(1)
        ),
        [-0.12, -0.06, -0.12],
        [0.12, 0.12, 0.12],
        SPACING,
    )


def upright(length, points=30):
    """Return one strand straight up from the origin."""
    along = np.linspace(0.0, length, points)
    return np.stack([np.zeros(points), along, np.zeros(points)], axis=1)[None]


@pytest.mark.parametrize("length", [0.07, 0.1])
def test_strands_end_a_quarter_of_a_voxel_below_the_border(length):
    share = share_inside(upright(length), slab(0.06))
    assert share * length == pytest.approx(0.06 - 0.25 * SPACING, abs=1e-4)


def test_strands_that_stay_in_are_whole():
    assert share_inside(upright(0.05), slab(0.06)) == 1.0


def test_strands_that_come_back_are_whole():
    half = upright(0.08)
    strand = np.concatenate([half, half[:, ::-1][:, 1:]], axis=1)
    assert share_inside(strand, slab(0.06)) == 1.0


def test_of_strands_that_were_never_in_the_hull_says_nothing():
    far = upright(0.03) + [0.0, 0.07, 0.0]
    beyond = upright(0.03) + [0.0, 0.5, 0.0]
    assert np.array_equal(
        share_inside(np.concatenate([far, beyond]), slab(0.06)), [1, 1]
    )


def test_strands_that_leave_the_grid_end_at_their_last_point_inside():
    points = 30
    strand = np.concatenate([upright(0.05, 15), upright(0.05, 15) + 5.0], axis=1)
    share = share_inside(strand, slab(0.06))
    assert share == pytest.approx(14 / (points - 1))


def test_thin_hair_is_not_taken_for_the_hulls_border():
    thin = hull_where(
        lambda p: (np.abs(p[:, 1]) < 0.5 * SPACING) & (np.abs(p[:, ::2]) < 0.1).all(1),
        [-0.12, -0.0625, -0.12],
        [0.12, 0.0625, 0.12],
        SPACING,
    )
    # A fifth of a voxel deep at its root, a strand ends a tenth deep.
    strand = upright(0.005, 60) + [0.0, 0.3 * SPACING, 0.0]
    share = share_inside(strand, thin)
    assert share * 0.005 == pytest.approx(0.1 * SPACING, abs=1e-4)


def test_strands_keep_a_twentieth():
    grown = upright(0.5) - [0.0, 0.001, 0.0]
    shallow = slab(0.0)
    assert share_inside(grown, shallow) == SHORTEST


@pytest.fixture(scope="module")
def tree():
    """A tree of a short cluster beside one that is 14 cm too long."""
    contour = jax.vmap(ScalpContour)(
        jnp.array([[0.3, 0.5], [0.7, 0.5]]), jnp.array([0.2, 0.2]), jnp.zeros((2, 32))
    )
    lengths = jnp.array([0.05, 0.2])
    planted = jax.vmap(lambda c, n: plant(dome(), c, n, 8))(contour, lengths)
    return HairTree(dome(), contour, planted, jnp.zeros(2), (-1, -1), maps=EVEN)


def heights(hair):
    return np.linalg.norm(np.asarray(hair.strands), axis=2).max(axis=1)


def test_other_strands_of_the_tree_end_inside_too(tree):
    hull = hull_where(
        lambda p: np.linalg.norm(p, axis=1) < REACH,
        [-REACH - 0.02] * 3,
        [REACH + 0.02] * 3,
        SPACING,
    )
    hair = sample_hair(tree, 3000, 32, jax.random.key(0))
    maps = with_tips_inside(EVEN, hair, hull)
    cut = dataclasses.replace(tree, maps=maps)
    before = sample_hair(tree, 500, 32, jax.random.key(1))
    after = sample_hair(cut, 500, 32, jax.random.key(1))
    long = np.asarray(before.owner) == 1
    assert (heights(before)[long] > REACH + 0.1).all()
    assert np.mean(heights(after)[long] < REACH) > 0.95
    assert np.median(heights(after)[long]) > REACH - 2 * SPACING
    kept = heights(after)[~long] > heights(before)[~long] - 1e-4
    assert np.mean(kept) > 0.9  # All but those between the clusters.


def test_neighbours_share_a_length_nearer_to_the_shorter():
    strands = np.concatenate([upright(0.05), upright(0.23)])
    uv = jnp.array([[0.5, 0.5], [0.5, 0.5]])
    hair = Hair(jnp.asarray(strands), uv, jnp.zeros(2, int), jnp.ones(2))
    maps = with_tips_inside(EVEN, hair, slab(0.06))
    quarter = (0.06 - 0.25 * SPACING) / 0.23
    mean = (0.5 + 0.5 * quarter**-2) ** -0.5
    assert maps.length.min() == pytest.approx(mean, abs=1e-3)
    assert maps.length[0, 0] == 1.0


def test_no_strands_leave_the_maps_as_they_are():
    assert eqx.tree_equal(with_tips_inside(EVEN, no_hair(), slab(0.06)), EVEN)
