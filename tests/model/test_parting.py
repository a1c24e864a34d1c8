import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.model import HairTree, contains, find_owner
from hairfit.model.parting import Parting, part

# A root cluster on each side of u = 0.5, one across it, and two clusters below that.
CIRCLES = [
    (0.25, 0.5, 0.2),
    (0.75, 0.5, 0.3),
    (0.5, 0.2, 0.15),
    (0.45, 0.2, 0.1),
    (0.56, 0.2, 0.1),
]
PARENT = (-1, -1, -1, 2, 2)
LINE = np.array([[0.5, 0.0], [0.5, 1.0]])


@pytest.fixture
def tree(flat, make_tree) -> HairTree:
    """Return hair on the plane y = 0 that leans towards the side of small u."""
    made = make_tree(flat, CIRCLES, PARENT, knots=6, seed=2)
    along = jnp.linspace(0.0, 0.2, 6)[:, None]
    lean = along * jnp.array([[0.0, 0.9, -0.4]])  # u runs along z
    root = made.cylinder.skeleton[:, :1]
    return eqx.tree_at(lambda t: t.cylinder.skeleton, made, root + lean[None])


def test_hair_leaves_the_parting_to_both_sides(tree):
    parted = part(tree, LINE, Parting(reach=0.5, length=0.3, strength=0.9))
    step = jnp.diff(parted.cylinder.skeleton, axis=1)
    old = jnp.diff(tree.cylinder.skeleton, axis=1)
    for index, side in ((0, -1.0), (1, 1.0), (3, -1.0), (4, 1.0)):
        assert jnp.all(side * step[index, :4, 2] > 0.0)
        assert side * step[index, 0, 2] > 0.015
        long = [jnp.linalg.norm(x[index], axis=1) for x in (step, old)]
        assert jnp.allclose(long[0], long[1], atol=1e-9)
        root = [t.cylinder.skeleton[index, 0] for t in (tree, parted)]
        assert jnp.array_equal(root[0], root[1])


def test_a_cluster_across_the_parting_stays_and_its_children_go_apart(tree):
    parted = part(tree, LINE, Parting(reach=0.2))
    assert jnp.array_equal(parted.cylinder.skeleton[2], tree.cylinder.skeleton[2])
    assert jnp.array_equal(parted.contour.radius[2], tree.contour.radius[2])
    assert not jnp.allclose(parted.cylinder.skeleton[4], tree.cylinder.skeleton[4])


def test_no_contour_of_one_side_reaches_over_the_parting(tree):
    parted = part(tree, LINE)
    beyond = jnp.array([0.49, 0.5])  # in cluster 1 before
    one = eqx.tree_at(lambda c: c.offset, contour_of(tree, 1), jnp.zeros(32))
    assert contains(one, beyond)
    assert not contains(contour_of(parted, 1), beyond)
    uv = jnp.array([[0.53, 0.2], [0.47, 0.2]])
    assert find_owner(parted, uv).tolist() == [4, 3]
    uncut = part(tree, LINE, Parting(cut=False))
    assert jnp.array_equal(uncut.contour.radius, tree.contour.radius)


def contour_of(tree, index):
    return eqx.tree_at(
        lambda c: (c.centre, c.radius, c.offset),
        tree.contour,
        (
            tree.contour.centre[index],
            tree.contour.radius[index],
            tree.contour.offset[index],
        ),
    )


def test_hair_far_from_the_parting_stays(tree):
    parted = part(tree, LINE, Parting(reach=0.1))
    assert jnp.allclose(
        parted.cylinder.skeleton[0], tree.cylinder.skeleton[0], atol=1e-9
    )


def test_a_parting_of_one_point_is_refused(tree):
    with pytest.raises(ValueError, match="parting needs at least 2 points, got 1"):
        part(tree, LINE[:1])
