import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.model.combed import (
    CombedShell,
    comb_cluster,
    outward_angle,
    square_to_disc,
)
from hairfit.model.combing import Comb, even_comb
from hairfit.model.contour import contour_radius
from hairfit.model.cylinder import (
    GeneralizedCylinder,
    cylinder_frames,
    cylinder_knots,
)
from hairfit.model.ownership import local_coordinates
from hairfit.model.strand import grow_strands
from hairfit.model.tree import cluster
from hairfit.model.wisp import Wisps

KNOTS, COUNT = 6, 60
CIRCLES = [(0.35, 0.5, 0.2), (0.7, 0.5, 0.2)]
to_disc = jax.jit(jax.vmap(square_to_disc))
coordinates = jax.jit(jax.vmap(local_coordinates, (None, 0)))


@pytest.fixture
def tree(dome, make_tree):
    """Two clusters that are stretched, sheared and twisted, of bumpy contours."""
    tree = make_tree(dome, CIRCLES, (-1, -1), knots=KNOTS)
    rng = np.random.default_rng(0)
    old = tree.cylinder
    cylinder = jax.vmap(GeneralizedCylinder)(
        old.skeleton,
        old.normal,
        old.radius,
        jnp.asarray(0.003 * rng.normal(size=old.offset.shape)),
        jnp.asarray(rng.uniform(0.5, 1.5, size=old.scale.shape)),
        old.twist,
        jnp.asarray(rng.normal(size=old.shear.shape)),
    )
    return eqx.tree_at(lambda t: t.cylinder, tree, cylinder)


@pytest.fixture
def comb() -> Comb:
    sway = 0.2 * jnp.linspace(0.0, 1.0, 4)
    return even_comb(3, sway, jax.random.key(5), depth=0.9)


def combed(tree, comb, index=0, **options):
    return comb_cluster(tree, index, comb, jax.random.key(1), COUNT, **options)


def wisps_of(tree) -> Wisps:
    assert tree.wisps is not None
    return tree.wisps


def test_squares_become_circles_and_keep_their_areas():
    s, u = jnp.asarray(np.random.default_rng(0).uniform(size=(2, 50)))
    square = jnp.maximum(jnp.abs(2.0 * s - 1.0), jnp.abs(2.0 * u - 1.0))
    assert jnp.allclose(to_disc(s, u).r, square, atol=1e-12)

    def point(su):
        r, theta = square_to_disc(su[0], su[1])
        return r * jnp.stack([jnp.cos(theta), jnp.sin(theta)])

    slope = jax.jit(jax.vmap(jax.jacfwd(point)))(jnp.stack([s, u], axis=1))
    assert jnp.allclose(jnp.linalg.det(slope), jnp.pi, rtol=1e-9)


def test_the_square_keeps_its_sides_in_the_disc():
    s = jnp.array([1.0, 0.5, 0.0, 0.5, 0.5, 1.0])
    u = jnp.array([0.5, 1.0, 0.5, 0.0, 0.5, 1.0])
    r, theta = to_disc(s, u)
    assert jnp.allclose(r, jnp.array([1.0, 1.0, 1.0, 1.0, 0.0, 1.0]))
    quarters = 0.5 * jnp.pi * jnp.arange(4.0)
    assert jnp.allclose(theta[:4], quarters, atol=1e-12)
    assert jnp.allclose(theta[5], 0.25 * jnp.pi)


def test_combed_strands_stay_in_the_contour_of_their_cluster(tree, comb):
    found = combed(tree, comb)
    wisps, whole = wisps_of(found), jnp.ones(COUNT)
    strands = grow_strands(found, wisps.uv, wisps.owner, whole, KNOTS)
    plain = grow_strands(tree, wisps.uv, wisps.owner, whole, KNOTS)
    assert jnp.max(jnp.abs(strands - plain)) > 0.005
    # Back to the plane of the contour: what is there must lie within it.
    one = cluster(tree.cylinder, 0)
    frames = jax.jit(cylinder_frames)(one)
    for k in range(1, KNOTS):
        rest = np.asarray(strands[:, k] - one.skeleton[k][None])
        assert np.allclose(rest @ frames.tangent[k], 0.0, atol=1e-12)
        y = rest @ frames.binormal[k] / one.scale[k, 1]
        x = (rest @ frames.normal[k] - one.shear[k] * y) / one.scale[k, 0]
        theta = jnp.asarray(np.arctan2(y, x)) - one.twist[k]
        reach = jax.vmap(contour_radius, (None, None, 0))(
            one.radius[k], one.offset[k], theta
        )
        assert np.all(np.hypot(x, y) <= reach * (1.0 + 1e-9))


def test_wisps_are_rooted_in_the_contour_and_do_not_move_there(tree, comb):
    wisps = wisps_of(combed(tree, comb))
    assert wisps.uv.shape == (COUNT, 2) and wisps.offset.shape == (COUNT, KNOTS, 3)
    assert jnp.all(wisps.owner == 0)
    assert jnp.all(wisps.offset[:, 0] == 0.0)
    assert jnp.all(wisps.offset[:, :, 0] == 0.0)  # nothing along the tangent
    r = coordinates(cluster(tree.contour, 0), wisps.uv).r
    assert jnp.all(r <= 1.0 + 1e-9) and jnp.max(r) > 0.9


def test_a_comb_that_touches_no_hair_moves_none(tree, comb):
    away = eqx.tree_at(lambda c: c.path, comb, jnp.full_like(comb.path, 9.0))
    assert jnp.allclose(wisps_of(combed(tree, away)).offset, 0.0, atol=1e-15)


def test_the_comb_enters_from_the_angle_given(tree, comb):
    # Shallow teeth: what moves is on the side that the comb comes from. Many layers,
    # or other hair would be pushed down a long way.
    shallow = eqx.tree_at(lambda c: c.depth, comb, jnp.asarray(0.3))
    shell = CombedShell(4, 12, angle=2.1)
    wisps = wisps_of(combed(tree, shallow, shell=shell))
    theta = coordinates(cluster(tree.contour, 0), wisps.uv).theta
    moved = jnp.max(jnp.abs(wisps.offset), axis=(1, 2)) > 1e-6
    side = jnp.cos(theta - 2.1)
    assert jnp.sum(moved) > 5
    assert jnp.mean(side[moved]) > jnp.mean(side[~moved]) + 0.5


def test_the_outward_angle_points_away_from_the_head(dome, make_tree):
    # A cluster that lies along x over the crown, 0.1 m above the middle.
    tree = make_tree(dome, [(0.5, 0.5, 0.2)], (-1,), knots=KNOTS)
    x = jnp.linspace(-0.02, 0.02, KNOTS)
    line = jnp.stack([x, jnp.full(KNOTS, 0.1), 0.0 * x], axis=1)
    skeleton = jnp.mean(dome.control, axis=(0, 1))[None] + line
    tree = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton[None])
    points = jax.jit(cylinder_knots)
    for twist in (0.0, 1.3):
        even = jnp.full((1, KNOTS), twist)
        turned = eqx.tree_at(lambda t: t.cylinder.twist, tree, even)
        angle = outward_angle(turned, 0)
        out = points(cluster(turned.cylinder, 0), 1.0, angle) - skeleton
        out = out / jnp.linalg.norm(out, axis=1, keepdims=True)
        assert jnp.all(out[:, 1] > 0.95)


def test_wisps_of_other_clusters_are_kept_and_own_ones_replaced(tree, comb):
    first = combed(tree, comb, 1)
    both = combed(first, [comb, comb], 0)
    wisps = wisps_of(both)
    assert wisps.owner.tolist() == [1] * COUNT + [0] * COUNT
    assert jnp.array_equal(wisps.offset[:COUNT], wisps_of(first).offset)
    again = wisps_of(combed(both, comb, 1))
    assert again.owner.tolist() == [0] * COUNT + [1] * COUNT


def test_single_precision_stays_single(tree, comb):
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), tree)
    wisps = wisps_of(combed(single, comb))
    assert wisps.uv.dtype == wisps.offset.dtype == jnp.float32
    want = wisps_of(combed(tree, comb))
    assert jnp.allclose(wisps.uv.astype(float), want.uv, atol=1e-5)


def test_only_leaves_are_combed(dome, make_tree, comb):
    tree = make_tree(dome, [*CIRCLES, (0.3, 0.5, 0.1)], (-1, -1, 0), knots=KNOTS)
    with pytest.raises(ValueError, match="cluster 0 is no leaf"):
        combed(tree, comb)


def test_combing_no_strands_is_refused(tree, comb):
    with pytest.raises(ValueError, match="at least 1 strand, got 0"):
        comb_cluster(tree, 1, comb, jax.random.key(0), 0)
