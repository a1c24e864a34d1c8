import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit import model
from hairfit.model import (
    HairTree,
    Scalp,
    ScalpContour,
    children,
    cluster,
    descendants,
    leaves,
    levels,
    stack,
)

plant = jax.jit(model.plant, static_argnames="knots")
point, normal = jax.jit(model.scalp_point), jax.jit(model.scalp_normal)
radius, knots = jax.jit(model.contour_radius), jax.jit(model.cylinder_knots)
CIRCLES = [(0.3, 0.5, 0.2), (0.7, 0.5, 0.2), (0.3, 0.5, 0.1), (0.7, 0.5, 0.1)]


def contour_at(u, v, radius) -> ScalpContour:
    offset = 0.1 * radius * jnp.cos(3 * jnp.arange(32.0) * (2 * jnp.pi / 32))
    return ScalpContour(jnp.array([u, v]), jnp.asarray(radius), offset)


def test_a_planted_cluster_is_equations_4_5_and_4_6_on_a_conformal_patch(flat):
    contour = contour_at(0.5, 0.4, 0.1)
    planted = plant(flat, contour, 0.3, knots=4)
    # u runs along z and v along x, at 1 m each: the contour is copied as it is.
    heights = jnp.array([0.0, 0.1, 0.2, 0.3])
    want = jnp.array([[0.4, 0.0, 0.5]]) + heights[:, None] * jnp.eye(3)[1:2]
    assert jnp.allclose(planted.skeleton, want, atol=1e-12)
    assert jnp.allclose(planted.normal, jnp.eye(3)[2], atol=1e-12)
    assert jnp.allclose(planted.scale, 1.0, atol=1e-9)
    assert jnp.allclose(planted.shear, 0.0, atol=1e-9)
    assert jnp.allclose(planted.twist, 0.0)
    reach = planted.radius[:, None] + planted.offset
    want = (contour.radius + contour.offset)[None]
    assert jnp.allclose(reach, jnp.tile(want, (4, 1)), atol=1e-9)
    assert jnp.allclose(jnp.mean(planted.offset), 0.0, atol=1e-12)


@pytest.mark.parametrize("which", ["stretched", "sheared", "mirrored", "dome"])
def test_a_planted_cluster_stands_over_its_contour_on_any_patch(flat, dome, which):
    maps = {
        "stretched": jnp.diag(jnp.array([0.5, 1.0, 1.0])),
        "sheared": jnp.array([[1.0, 0, 0.6], [0, 1, 0], [0, 0, 1]]),
        "mirrored": jnp.diag(jnp.array([-1.0, 1.0, 1.0])),
    }
    scalp = dome if which == "dome" else Scalp(flat.control @ maps[which].T)
    contour = contour_at(0.5, 0.4, 0.05)
    planted = plant(scalp, contour, 0.3, knots=4)
    centre, up = point(scalp, contour.centre), normal(scalp, contour.centre)
    for angle in np.arange(0, 2 * np.pi, np.pi / 4):
        reach = radius(contour.radius, contour.offset, angle)
        spoke = jnp.array([jnp.cos(angle), jnp.sin(angle)])
        on_scalp = point(scalp, contour.centre + reach * spoke)
        on_cluster = knots(planted, 1.0, float(angle))[0]
        apart = on_scalp - on_cluster
        size = jnp.linalg.norm(on_scalp - centre)
        apart -= jnp.dot(apart, up) * up
        tolerance = 0.03 if which == "dome" else 1e-9  # the dome's map is not linear
        assert jnp.linalg.norm(apart) < tolerance * size


def test_planting_has_gradients(dome):
    def planted(scalp, contour, length):
        return plant(scalp, contour, length, knots=4)

    arguments = (dome, contour_at(0.52, 0.41, 0.1), 0.3)
    check_grads(planted, arguments, order=1, eps=1e-6, modes=["rev"])


@pytest.mark.parametrize("case", ["no radius", "a pinched patch"])
def test_planting_has_finite_gradients(dome, case):
    contour, scalp = contour_at(0.5, 0.0, 0.0), dome
    if case == "a pinched patch":
        scalp = Scalp(jnp.zeros((13, 13, 3)))

    def size(scalp, contour):
        leaves = jax.tree.leaves(model.plant(scalp, contour, 0.3, 4))
        return sum(jnp.sum(jnp.sin(leaf)) for leaf in leaves)

    slope = jax.jit(jax.grad(size, argnums=(0, 1)))
    for leaf in jax.tree.leaves(slope(scalp, contour)):
        assert jnp.all(jnp.isfinite(leaf))


def test_levels_leaves_children_and_descendants(flat, make_tree):
    tree = make_tree(flat, [*CIRCLES, (0.7, 0.5, 0.05)], (-1, -1, 0, 1, 3))
    assert tree.count == 5
    assert [x.tolist() for x in levels(tree)] == [[0, 1], [2, 3], [4]]
    assert leaves(tree).tolist() == [2, 4]
    assert children(tree, -1).tolist() == [0, 1]
    assert children(tree, 1).tolist() == [3]
    assert descendants(tree, 1).tolist() == [3, 4]
    assert descendants(tree, 4).tolist() == []


def test_stack_and_cluster_are_inverse(flat):
    contours = [contour_at(*c) for c in CIRCLES]
    stacked = stack(contours)
    assert stacked.centre.shape == (4, 2)
    third = cluster(stacked, 2)
    for got, want in zip(
        jax.tree.leaves(third), jax.tree.leaves(contours[2]), strict=True
    ):
        assert jnp.array_equal(got, want)
    with pytest.raises(ValueError, match="at least one module, got none"):
        stack([])


def test_a_child_before_its_parent_is_refused(flat, make_tree):
    with pytest.raises(ValueError, match="cluster 0 has the parent 1; a parent is -1"):
        make_tree(flat, CIRCLES[:2], (1, -1))


def test_arrays_of_other_counts_than_the_topology_are_refused(flat, make_tree):
    tree = make_tree(flat, CIRCLES, (-1, -1, 0, 1))
    with pytest.raises(ValueError, match="`contour` of a tree of 3 clusters needs"):
        HairTree(
            flat, tree.contour, tree.cylinder, tree.length_variation, tree.parent[:3]
        )
