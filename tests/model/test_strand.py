import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit import model
from hairfit.model import find_owner, grow_strands, sample_strands
from hairfit.model.maps import even_maps
from hairfit.model.strand import grow, sample_hair

CIRCLES = [(0.3, 0.5, 0.25), (0.7, 0.5, 0.25), (0.3, 0.5, 0.15), (0.7, 0.4, 0.2)]
PARENT = (-1, -1, 0, 1)
KNOTS = 6


@pytest.fixture
def tree(dome, make_tree):
    return make_tree(dome, CIRCLES, PARENT, knots=KNOTS)


@pytest.fixture
def roots():
    return jnp.asarray([[0.31, 0.52], [0.25, 0.46], [0.72, 0.43], [0.9, 0.9]])


def test_strands_are_rooted_on_the_scalp_exactly(tree, roots):
    owner = find_owner(tree, roots)
    strands = grow_strands(tree, roots, owner, jnp.ones(4), 11)
    want = jax.vmap(model.scalp_point, (None, 0))(tree.scalp, roots)
    assert jnp.allclose(strands[:, 0], want, rtol=0.0, atol=1e-16)


def test_whole_strands_run_through_the_knots_of_their_cylinder(tree, roots):
    owner = find_owner(tree, roots)
    assert owner.tolist() == [2, 2, 3, -1]
    per_knot = 4
    points = (KNOTS - 1) * per_knot + 1
    strands = grow_strands(tree, roots, owner, jnp.ones(4), points)
    knots_of = jax.jit(model.cylinder_knots)
    for strand, uv, index in zip(strands[:3], roots, owner[:3].tolist(), strict=False):
        contour = model.cluster(tree.contour, index)
        r, theta = model.local_coordinates(contour, uv)
        knots = knots_of(model.cluster(tree.cylinder, index), r, theta)
        assert jnp.allclose(strand[per_knot::per_knot], knots[1:], atol=1e-9)


def test_shorter_strands_run_through_the_cylinder_up_to_their_share(tree, roots):
    owner, eta = find_owner(tree, roots), jnp.full(4, 0.73)
    strands = grow_strands(tree, roots, owner, eta, KNOTS)
    index = int(owner[0])
    cylinder = model.cluster(tree.cylinder, index)
    r, theta = model.local_coordinates(model.cluster(tree.contour, index), roots[0])
    point = jax.jit(model.cylinder_point)
    for k in range(1, KNOTS):
        want = point(cylinder, r, theta, 0.73 * k / (KNOTS - 1))
        assert jnp.allclose(strands[0, k], want, atol=1e-9)


def test_a_strand_without_an_owner_does_not_grow(tree, roots):
    strand = grow_strands(tree, roots, find_owner(tree, roots), jnp.ones(4), 5)[3]
    assert jnp.allclose(strand, strand[:1], rtol=0.0, atol=1e-16)


def test_another_topology_does_not_compile_again(dome, make_tree, roots):
    owner = jnp.array([2, 2, 3, 3], jnp.int32)
    programs = []
    for parent in (PARENT, (-1, -1, 0, 0), (-1, -1, -1, -1)):
        tree = make_tree(dome, CIRCLES, parent, knots=KNOTS)
        grow_strands(tree, roots, owner, jnp.ones(4), 9)
        programs.append(getattr(grow, "_cache_size")())  # noqa: B009
    assert programs[0] == programs[1] == programs[2]


def test_single_precision_stays_single(tree, roots):
    single = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), tree)
    owner = find_owner(tree, roots)
    arguments = owner, jnp.ones(4, jnp.float32), 7
    strands = grow_strands(single, roots.astype(jnp.float32), *arguments)
    assert strands.dtype == jnp.float32
    want = grow_strands(tree, roots, owner, jnp.ones(4), 7)
    assert jnp.allclose(strands.astype(float), want, atol=1e-6)


def test_gradients_of_strands(tree, roots):
    owner = find_owner(tree, roots)

    @jax.jit
    def strands(tree, uv, eta):
        return grow_strands(tree, uv, owner, eta, 9)

    eta = jnp.array([0.9, 0.83, 0.77, 0.6])
    check_grads(strands, (tree, roots, eta), order=1, eps=1e-6, modes=["rev"])


def test_gradients_are_finite_for_straight_clusters_without_radius(dome, make_tree):
    tree = make_tree(dome, [(0.5, 0.5, 0.0)], (-1,))
    skeleton = jnp.linspace(0.0, 0.2, KNOTS)[:, None] * jnp.eye(3)[1:2]
    tree = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton[None])
    uv = jnp.array([[0.5, 0.5], [0.6, 0.6]])

    def size(tree, uv, eta):
        grown = grow_strands(tree, uv, jnp.zeros(2, jnp.int32), eta, 9)
        return jnp.sum(grown**2)

    slope = jax.jit(jax.grad(size, argnums=(0, 1, 2)))(tree, uv, jnp.ones(2))
    for leaf in jax.tree.leaves(slope):
        assert jnp.all(jnp.isfinite(leaf))


def test_sampled_strands_have_owners_and_vary_in_length(dome, make_tree):
    tree = make_tree(dome, CIRCLES, PARENT, knots=KNOTS, variation=0.4)
    strands = sample_strands(tree, 300, 17, jax.random.key(0))
    assert strands.shape == (300, 17, 3)
    lengths = jax.vmap(lambda s: model.arc_length(s)[-1])(strands)
    assert jnp.max(lengths) / jnp.min(lengths) > 1.4
    again = sample_strands(tree, 300, 17, jax.random.key(0))
    assert np.array_equal(strands, again)
    # Every root lies in a root cluster.
    uv = jax.jit(jax.vmap(model.scalp_uv, (None, 0)))(dome, strands[:, 0])
    assert jnp.all(find_owner(tree, uv) >= 0)


def test_a_tree_that_covers_nothing_has_no_strands(dome, make_tree):
    tree = make_tree(dome, [(0.5, 0.5, 0.0)], (-1,))
    assert sample_strands(tree, 10, 5, jax.random.key(0)).shape == (0, 5, 3)


def test_a_tree_that_covers_little_gives_as_many_strands_as_asked(dome, make_tree):
    tree = make_tree(dome, [(0.5, 0.5, 0.1)], (-1,))
    assert sample_strands(tree, 500, 5, jax.random.key(0)).shape == (500, 5, 3)


def painted(tree, **fields):
    maps = even_maps(5, 5)
    maps = dataclasses.replace(maps, **fields)
    return dataclasses.replace(tree, maps=maps)


def test_unpainted_maps_change_no_strand(tree):
    plain = sample_strands(tree, 60, 9, jax.random.key(0))
    same = sample_strands(painted(tree), 60, 9, jax.random.key(0))
    assert jnp.allclose(same, plain, rtol=0, atol=1e-14)


def test_no_hair_grows_where_the_scalp_is_painted_bald(tree):
    density = jnp.ones((5, 5)).at[2:].set(0.0)  # linear from 1 at u = 1/4 to 0
    hair = model.sample_hair(painted(tree, density=density), 400, 5, jax.random.key(0))
    assert hair.strands.shape == (400, 5, 3)
    assert jnp.max(hair.uv[:, 0]) < 0.5
    # Where it falls off, as much hair grows as the density says.
    even = model.sample_hair(tree, 2000, 5, jax.random.key(1)).uv[:, 0]
    weight = np.interp(np.asarray(even), np.linspace(0.0, 1.0, 5), density[:, 0])
    falls = np.asarray(even) > 0.25
    want = float(weight[falls].sum() / weight.sum())
    assert abs(jnp.mean(hair.uv[:, 0] > 0.25) - want) < 0.08


def test_painted_lengths_shorten_what_grows(tree):
    half = painted(tree, length=jnp.full((5, 5), 0.5))
    hair = model.sample_hair(half, 30, 9, jax.random.key(0))
    assert jnp.allclose(hair.eta, 0.5)
    want = grow_strands(tree, hair.uv, hair.owner, jnp.full(30, 0.5), 9)
    assert jnp.allclose(hair.strands, want, rtol=0, atol=1e-14)


def test_painted_curls_keep_roots_and_stay_near_the_strand(tree):
    curl = painted(tree, curl=jnp.full((5, 5), 0.004))
    hair = model.sample_hair(curl, 30, 60, jax.random.key(0))
    plain = grow_strands(tree, hair.uv, hair.owner, hair.eta, 60)
    apart = jnp.linalg.norm(hair.strands - plain, axis=2)
    assert jnp.all(apart[:, 0] == 0.0)
    assert jnp.allclose(jnp.max(apart, axis=1), 0.004, rtol=1e-6)


def test_sampled_strands_are_those_of_the_tree_and_have_its_gradients(tree):
    """Sampling fills the arrays of clusters, but not those that are traced."""
    key = jax.random.key(3)
    hair = sample_hair(tree, 50, 9, key)
    grown = grow_strands(tree, hair.uv, hair.owner, hair.eta, 9)
    assert jnp.allclose(hair.strands, grown, atol=1e-15)

    def height(skeleton, strands_of):
        other = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton)
        return jnp.sum(strands_of(other)[..., 1])

    found = jax.grad(height)(
        tree.cylinder.skeleton, lambda t: sample_strands(t, 50, 9, key)
    )
    wanted = jax.grad(height)(
        tree.cylinder.skeleton,
        lambda t: grow_strands(t, hair.uv, hair.owner, hair.eta, 9),
    )
    assert jnp.abs(wanted).max() > 0.1
    assert jnp.allclose(found, wanted, atol=1e-12)
