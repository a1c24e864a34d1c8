import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from hairfit import model
from hairfit.model import HairTree, Scalp, ScalpContour, find_owner

local_coordinates = jax.jit(model.local_coordinates)
contains = jax.jit(model.contains)
contour_radius = jax.jit(model.contour_radius)


def tree_of(centre, radius, offset, parent) -> HairTree:
    """Return a tree of which only the contours and the topology matter."""
    contour = jax.vmap(ScalpContour)(
        jnp.asarray(centre), jnp.asarray(radius), jnp.asarray(offset)
    )
    count = len(parent)
    cylinder = jax.vmap(model.GeneralizedCylinder)(
        jnp.zeros((count, 4, 3)),
        jnp.zeros((count, 3)),
        jnp.zeros((count, 4)),
        jnp.zeros((count, 4, 32)),
        jnp.zeros((count, 4, 2)),
        jnp.zeros((count, 4)),
        jnp.zeros((count, 4)),
    )
    scalp = Scalp(jnp.zeros((13, 13, 3)))
    return HairTree(scalp, contour, cylinder, jnp.zeros(count), tuple(parent))


def circles(*rows, parent) -> HairTree:
    rows = np.array(rows, float)
    return tree_of(rows[:, :2], rows[:, 2], np.zeros((len(rows), 32)), parent)


def owners(tree, *uv) -> list[int]:
    return find_owner(tree, np.array(uv, float)).tolist()


def figure_4_15(tree: HairTree, u: float, v: float) -> int:
    """The figure, line by line for one strand, in plain Python.

    "Closer than O" compares within one level, or among the leaves, as the text has it.
    """
    centre = np.asarray(tree.contour.centre).tolist()
    radius = np.asarray(tree.contour.radius).tolist()
    offset = np.asarray(tree.contour.offset).tolist()

    def distance(cluster):
        du, dv = u - centre[cluster][0], v - centre[cluster][1]
        return math.sqrt(du * du + dv * dv)

    def contains(cluster):
        du, dv = u - centre[cluster][0], v - centre[cluster][1]
        place = math.atan2(dv, du) % (2 * math.pi) * 32 / (2 * math.pi)
        i = math.floor(place)
        f = place - i
        spoke = (1 - f) * offset[cluster][i % 32] + f * offset[cluster][(i + 1) % 32]
        return distance(cluster) <= radius[cluster] + spoke

    def children(cluster):
        return [i for i, parent in enumerate(tree.parent) if parent == cluster]

    def leaves_below(cluster):
        if not children(cluster):
            return [cluster]
        return sorted(leaf for c in children(cluster) for leaf in leaves_below(c))

    owner, siblings, done = -1, children(-1), False
    while not done and siblings:
        done, closest = True, math.inf
        for sibling in siblings:
            if contains(sibling) and distance(sibling) < closest:
                owner, closest, done = sibling, distance(sibling), False
        if not done:
            siblings = children(owner)
    if owner >= 0 and children(owner):
        closest, above = math.inf, owner
        for leaf in leaves_below(above):
            if distance(leaf) < closest:
                owner, closest = leaf, distance(leaf)
    return owner


def test_a_root_outside_all_root_clusters_has_no_owner():
    # Not even where a child reaches over its parent's border.
    tree = circles((0.3, 0.5, 0.1), (0.38, 0.5, 0.1), parent=(-1, 0))
    assert owners(tree, (0.9, 0.9), (0.45, 0.5), (0.35, 0.5)) == [-1, -1, 1]


def test_in_an_overlap_the_closest_centre_wins():
    tree = circles((0.3, 0.5, 0.2), (0.5, 0.5, 0.2), parent=(-1, -1))
    assert owners(tree, (0.39, 0.5), (0.41, 0.5)) == [0, 1]


def test_of_equal_distances_the_first_wins():
    tree = circles((0.25, 0.5, 0.3), (0.75, 0.5, 0.3), parent=(-1, -1))
    assert owners(tree, (0.5, 0.5)) == [0]


def test_a_contour_that_contains_beats_a_closer_centre_that_does_not():
    tree = circles((0.3, 0.5, 0.3), (0.55, 0.5, 0.02), parent=(-1, -1))
    assert owners(tree, (0.5, 0.5)) == [0]


def test_a_child_that_contains_wins_however_close_the_parents_centre_is():
    tree = circles((0.5, 0.5, 0.4), (0.8, 0.5, 0.3), (0.5, 0.7, 0.1), parent=(-1, 0, 0))
    assert owners(tree, (0.52, 0.5)) == [1]


def test_the_closest_root_cluster_decides_though_another_has_a_leaf_there():
    tree = circles(
        (0.4, 0.5, 0.2),
        (0.6, 0.5, 0.2),
        (0.3, 0.5, 0.02),
        (0.5, 0.5, 0.2),
        parent=(-1, -1, 0, 1),
    )
    # At 0.49 root cluster 0 is closer, so leaf 3 is not asked, though it contains it.
    assert owners(tree, (0.49, 0.5), (0.51, 0.5)) == [2, 3]


def test_between_the_children_the_closest_leaf_below_owns():
    tree = circles(
        (0.5, 0.5, 0.4),
        (0.3, 0.5, 0.05),
        (0.7, 0.5, 0.05),
        (0.2, 0.5, 0.01),
        (0.42, 0.5, 0.01),
        parent=(-1, 0, 0, 1, 1),
    )
    # 1 is not a leaf: its leaves 3 and 4 stand for it, 4 with the closest centre.
    assert owners(tree, (0.5, 0.5), (0.7, 0.51), (0.3, 0.5)) == [4, 2, 3]


def test_no_strands_have_no_owners():
    tree = circles((0.5, 0.5, 0.4), parent=(-1,))
    assert find_owner(tree, np.zeros((0, 2))).shape == (0,)


def test_in_a_tree_without_clusters_no_root_has_an_owner():
    empty = model.drop(circles((0.5, 0.5, 0.4), parent=(-1,)), 0)
    assert empty.count == 0
    assert owners(empty, (0.5, 0.5), (0.1, 0.9)) == [-1, -1]
    assert find_owner(empty, np.zeros((0, 2))).shape == (0,)
    assert model.levels(empty) == ()
    assert len(model.leaves(empty)) == 0
    assert len(model.children(empty, -1)) == 0


def test_clusters_at_one_place_leave_all_to_the_first_leaf():
    tree = circles(*[(0.5, 0.5, 0.2)] * 5, parent=(-1, -1, 0, 0, 1))
    assert owners(tree, (0.5, 0.5), (0.5, 0.65), (0.9, 0.9)) == [2, 2, -1]


def test_between_children_of_equal_distance_the_first_owns():
    tree = circles(
        (0.5, 0.5, 0.5), (0.75, 0.5, 0.125), (0.25, 0.5, 0.125), parent=(-1, 0, 0)
    )
    assert owners(tree, (0.5, 0.5), (0.5, 0.75), (0.375, 0.5)) == [1, 1, 2]


def test_a_contour_with_nothing_inside_owns_nothing():
    # Not even a root at its centre, if its radius is negative.
    tree = circles((0.5, 0.5, 0.0), (0.3, 0.3, -0.1), parent=(-1, -1))
    assert owners(tree, (0.5, 0.5), (0.5, 0.50001), (0.3, 0.3)) == [0, -1, -1]


def test_a_chain_of_clusters_is_followed_to_its_end():
    chain = circles(*[(0.5, 0.5, 0.4)] * 40, parent=range(-1, 39))
    assert owners(chain, (0.5, 0.6), (0.5, 0.95)) == [39, -1]


@st.composite
def topologies(draw) -> list[int]:
    count = draw(st.integers(1, 12))
    return [draw(st.integers(-1, i - 1)) for i in range(count)]


def ragged_tree(parent: list[int], rng: np.random.Generator) -> HairTree:
    count = len(parent)
    radius = rng.uniform(0.0, 0.6, count)
    offset = radius[:, None] * rng.uniform(-1.2, 0.5, (count, 32))
    return tree_of(rng.uniform(size=(count, 2)), radius, offset, parent)


@settings(max_examples=60, deadline=None)
@given(topologies(), st.integers(0, 2**31))
def test_owners_are_those_of_the_figure(parent, seed):
    rng = np.random.default_rng(seed)
    tree, uv = ragged_tree(parent, rng), rng.uniform(size=(40, 2))
    want = [figure_4_15(tree, *root) for root in uv.tolist()]
    assert find_owner(tree, uv).tolist() == want


@settings(max_examples=60, deadline=None)
@given(topologies(), st.integers(0, 2**31))
def test_owners_are_those_of_the_figure_where_distances_are_equal(parent, seed):
    # Centres, radii and roots of a coarse grid: ties at every turn, and on borders.
    rng = np.random.default_rng(seed)
    rows = rng.integers(0, 5, (len(parent), 3)) / 4
    tree, uv = circles(*rows, parent=parent), rng.integers(0, 9, (60, 2)) / 8
    want = [figure_4_15(tree, *root) for root in uv.tolist()]
    assert find_owner(tree, uv).tolist() == want


@settings(max_examples=40, deadline=None)
@given(topologies(), st.integers(0, 2**31))
def test_only_leaves_own_and_all_that_a_root_cluster_contains_is_owned(parent, seed):
    rng = np.random.default_rng(seed)
    rows = rng.uniform([0.0, 0.0, 0.0], [1.0, 1.0, 0.5], (len(parent), 3))
    tree, uv = circles(*rows, parent=parent), rng.uniform(size=(60, 2))
    owner = np.asarray(find_owner(tree, uv))
    assert set(owner.tolist()) <= {-1, *model.leaves(tree).tolist()}
    top = rows[np.asarray(parent) < 0]
    apart = np.linalg.norm(uv[:, None] - top[None, :, :2], axis=2)
    assert np.array_equal(owner >= 0, np.any(apart <= top[:, 2], axis=1))


@settings(max_examples=20, deadline=None)
@given(topologies(), st.integers(0, 2**31))
def test_owners_do_not_depend_on_the_order_of_the_roots(parent, seed):
    rng = np.random.default_rng(seed)
    tree, uv = ragged_tree(parent, rng), rng.uniform(size=(60, 2))
    order = rng.permutation(60)
    assert np.array_equal(find_owner(tree, uv)[order], find_owner(tree, uv[order]))


@pytest.mark.parametrize("seed", range(5))
def test_containing_is_a_share_of_the_radius_of_at_most_one(seed):
    rng = np.random.default_rng(seed)
    contour = model.cluster(ragged_tree([-1], rng).contour, 0)
    for uv in jnp.asarray(rng.uniform(size=(20, 2))):
        r, theta = local_coordinates(contour, uv)
        radius = contour_radius(contour.radius, contour.offset, theta)
        if radius > 1e-6:
            assert bool(contains(contour, uv)) == bool(r <= 1.0)
            spoke = jnp.stack([jnp.cos(theta), jnp.sin(theta)])
            back = contour.centre + r * radius * spoke
            assert jnp.allclose(back, uv, atol=1e-12)


@pytest.mark.parametrize("angle_deg", [0, 30, 90, 150, 180, 210, 270, 330])
def test_angles_go_all_the_way_round(angle_deg):
    angle = np.radians(angle_deg)
    contour = ScalpContour(jnp.full(2, 0.5), jnp.asarray(0.2), jnp.zeros(32))
    uv = jnp.asarray([0.5 + 0.1 * np.cos(angle), 0.5 + 0.1 * np.sin(angle)])
    r, theta = local_coordinates(contour, uv)
    turn = (float(theta) - angle + np.pi) % (2 * np.pi) - np.pi
    assert abs(turn) < 1e-12
    assert abs(r - 0.5) < 1e-12


def test_gradients_of_local_coordinates():
    offset = 0.02 * jnp.cos(jnp.arange(32.0))
    contour = ScalpContour(jnp.full(2, 0.5), jnp.asarray(0.2), offset)
    for uv in ([0.61, 0.47], [0.4, 0.55]):
        check_grads(local_coordinates, (contour, jnp.asarray(uv)), order=1, eps=1e-6)


@pytest.mark.parametrize("radius", [0.2, 0.0])
@pytest.mark.parametrize("uv", [[0.5, 0.5], [0.6, 0.5]])
def test_gradients_are_finite_at_the_centre_and_without_radius(radius, uv):
    contour = ScalpContour(jnp.full(2, 0.5), jnp.asarray(radius), jnp.zeros(32))
    slope = jax.jit(jax.jacrev(model.local_coordinates, argnums=(0, 1)))
    for leaf in jax.tree.leaves(slope(contour, jnp.asarray(uv))):
        assert jnp.all(jnp.isfinite(leaf))
