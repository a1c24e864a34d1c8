import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads
from scipy.optimize import linprog

from hairfit import model
from hairfit.model import (
    ScalpContour,
    ScalpMaps,
    Wisps,
    find_owner,
    grow_strands,
    tiling,
)
from hairfit.model.tiling import part_tree, tile_contours

cut_contour = jax.jit(tiling.cut_contour)
cut_reach = jax.jit(tiling.cut_reach)
line_below = jax.jit(tiling.line_below)
MIDDLE = np.array([[0.5, -1.0], [0.5, 2.0]])


def circle(u, v, radius) -> ScalpContour:
    return ScalpContour(jnp.array([u, v]), jnp.array(radius), jnp.zeros(32))


def outlines(contours: ScalpContour) -> np.ndarray:
    each = jax.jit(jax.vmap(lambda c: tiling.contour_outline(c, 32 * 9 * 4 + 1)))
    return np.asarray(each(contours))


def tree_of(contours: ScalpContour, make_tree, scalp) -> model.HairTree:
    count = len(contours.radius)
    tree = make_tree(scalp, [(0.5, 0.5, 0.1)] * count, [-1] * count)
    return eqx.tree_at(lambda t: t.contour, tree, contours)


def test_a_cell_ends_halfway_to_its_neighbour_and_at_the_border_of_the_patch():
    reach = tiling.cell_reach(np.array([[0.3, 0.5], [0.7, 0.5]]))
    assert np.allclose(reach[0, [0, 8, 16, 24]], [0.2, 0.5, 0.3, 0.5])
    # 4 / 32 of a turn is 45 degrees: the bisector is root 2 further away.
    assert np.allclose(reach[1, [0, 4, 12, 16]], [0.3, 0.3 * 2**0.5, 0.2 * 2**0.5, 0.2])


def test_a_centre_on_the_border_of_the_patch_has_a_cell():
    assert np.all(tiling.cell_reach(np.array([[0.0, 0.5], [0.7, 1.0]])) > 0.0)


def test_tiles_give_every_root_to_the_closest_centre(make_tree, flat):
    rng = np.random.default_rng(0)
    centres, uv = rng.uniform(size=(30, 2)), rng.uniform(size=(5000, 2))
    tree = tree_of(tile_contours(centres, 1.15), make_tree, flat)
    closest = np.linalg.norm(uv[:, None] - centres[None], axis=2).argmin(axis=1)
    owner = np.asarray(find_owner(tree, uv))
    assert np.mean(owner == closest) > 0.995
    assert np.mean(owner >= 0) > 0.999


def test_tiles_beside_a_border_are_those_of_their_own_side(make_tree, flat):
    rng = np.random.default_rng(1)
    centres, uv = rng.uniform(size=(24, 2)), rng.uniform(size=(5000, 2))
    tree = tree_of(tile_contours(centres, 1.15, [MIDDLE]), make_tree, flat)
    apart = np.linalg.norm(uv[:, None] - centres[None], axis=2)
    apart[(uv[:, None, 0] < 0.5) != (centres[None, :, 0] < 0.5)] = np.inf
    owner = np.asarray(find_owner(tree, uv))
    assert np.mean(owner == apart.argmin(axis=1)) > 0.985
    held = owner >= 0
    left = uv[held, 0] < 0.5
    assert np.mean(left == (centres[owner[held], 0] < 0.5)) > 0.9995


def test_centres_are_parted_only_where_the_border_runs():
    border = np.array([[0.5, 0.0], [0.5, 0.3]])
    centres = np.array([[0.4, 0.2], [0.6, 0.2], [0.4, 0.5], [0.6, 0.5]])
    want = np.zeros((4, 4), bool)
    want[0, 1] = want[1, 0] = True
    assert np.array_equal(tiling.parted(centres, [border]), want)


def test_the_outline_is_the_closed_curve_where_r_is_1():
    rng = np.random.default_rng(0)
    offset = jnp.asarray(rng.uniform(-0.05, 0.05, 32))
    contour = ScalpContour(jnp.array([0.4, 0.6]), jnp.array(0.2), offset)
    outline = tiling.contour_outline(contour, 97)
    assert jnp.allclose(outline[0], outline[-1])
    r = jax.jit(jax.vmap(model.local_coordinates, (None, 0)))(contour, outline).r
    assert jnp.allclose(r, 1.0, atol=1e-12)


def test_a_cut_circle_ends_at_the_border_and_is_whole_elsewhere():
    share = cut_reach(circle(0.3, 0.5, 0.4), MIDDLE)
    # The border is 0.2 to the right: spokes within 60 degrees of it are cut.
    angle = np.arange(-5, 6) * (2 * np.pi / 32)
    want = 0.5 / np.cos(angle)
    assert np.all(share[np.arange(-5, 6)] <= want + 1e-4)
    assert np.all(share[np.arange(-5, 6)] >= 0.95 * want)
    assert np.allclose(share[7:26], 1.0, atol=1e-12)


@st.composite
def contours(draw) -> ScalpContour:
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    offset = 0.3 * draw(st.floats(0.0, 0.9)) * rng.uniform(-1.0, 1.0, 32)
    return ScalpContour(jnp.array([0.5, 0.5]), jnp.array(0.3), jnp.asarray(offset))


@settings(max_examples=60, deadline=None)
@given(contours(), st.floats(0.03, 0.3), st.floats(0.0, 6.28))
def test_a_cut_contour_does_not_cross_a_straight_border(contour, away, turn):
    normal = np.array([np.cos(turn), np.sin(turn)])
    along = np.array([-normal[1], normal[0]])
    border = 0.5 + away * normal + np.array([[-2.0], [2.0]]) * along
    after = cut_contour(contour, jnp.asarray(border))
    over = (outlines(model.stack([after]))[0] - 0.5) @ normal - away
    assert over.max() < 0.008 * away
    reach = after.radius + after.offset
    assert jnp.all(reach <= contour.radius + contour.offset + 1e-12)


@settings(max_examples=40, deadline=None)
@given(contours(), st.integers(0, 2**31))
def test_what_a_border_does_not_meet_stays(contour, seed):
    # A border of some turns, far from the spokes 16 to 31.
    rng = np.random.default_rng(seed)
    border = np.stack([np.linspace(0.9, 0.1, 6), rng.uniform(0.55, 0.9, 6)], axis=1)
    share = cut_reach(contour, jnp.asarray(border))
    assert jnp.allclose(share[18:31], 1.0, atol=1e-12)
    assert jnp.all((share >= 0.0) & (share <= 1.0 + 1e-12))


def test_a_centre_on_the_border_keeps_nothing():
    assert jnp.allclose(cut_reach(circle(0.5, 0.5, 0.3), MIDDLE), 0.0, atol=1e-12)


def test_a_border_of_one_point_is_refused():
    with pytest.raises(ValueError, match="at least 2 points, got 1"):
        tiling.cut_contour(circle(0.5, 0.5, 0.3), MIDDLE[:1])


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=10, max_size=10))
def test_no_line_below_samples_is_higher_in_the_middle(values):
    at, y = np.arange(10) / 9, np.array(values)
    first, last = np.asarray(line_below(jnp.asarray(at), jnp.asarray(y)))
    assert min(first, last) >= 0.0
    assert np.all(first + at * (last - first) <= y + 1e-9)
    below = np.stack([1 - at, at], axis=1)
    free = linprog([-0.5, -0.5], below, y, bounds=[(None, None)] * 2)
    if free.x.min() > 1e-6:
        assert abs(0.5 * (first + last) + free.fun) < 1e-7


def test_gradients_of_a_cut():
    border = jnp.array([[0.62, -1.0], [0.58, 2.0]])

    @jax.jit
    def area(centre, border):
        contour = ScalpContour(centre, jnp.array(0.3), jnp.zeros(32))
        return jnp.sum(cut_reach(contour, border) ** 2)

    check_grads(area, (jnp.array([0.5, 0.5]), border), order=1, eps=1e-7)
    slope = jax.jit(jax.grad(area, argnums=(0, 1)))
    for leaf in jax.tree.leaves(slope(jnp.array([0.6, 0.5]), border)):
        assert jnp.all(jnp.isfinite(leaf))


@pytest.fixture
def crossed(make_tree, flat):
    """A tree with two circles on the middle, and one besides; wisps, and maps."""
    tree = make_tree(
        flat, [(0.4, 0.5, 0.3), (0.6, 0.5, 0.3), (0.1, 0.1, 0.1)], [-1] * 3
    )
    uv = jnp.array([[0.48, 0.5], [0.52, 0.5], [0.1, 0.1]])
    wisps = Wisps(uv, find_owner(tree, uv), jnp.zeros((3, 6, 3)))
    even = jnp.ones((2, 2))
    maps = ScalpMaps(even, even, even, jnp.ones((2, 2, 3)), even)
    return eqx.tree_at(
        lambda t: (t.wisps, t.maps), tree, (wisps, maps), is_leaf=lambda x: x is None
    )


def test_after_a_parting_no_strand_belongs_to_the_other_side(crossed):
    uv = jnp.asarray(np.random.default_rng(0).uniform(size=(4000, 2)))
    after = part_tree(crossed, [MIDDLE])
    owner = np.asarray(find_owner(after, uv))
    assert np.all(uv[owner == 0, 0] < 0.501)
    assert np.all(uv[owner == 1, 0] > 0.499)
    before = np.asarray(find_owner(crossed, uv))
    # The two circles meet in the middle: what one loses, the other has already.
    assert np.mean((owner >= 0) == (before >= 0)) > 0.99
    assert eqx.tree_equal(after.maps, crossed.maps)
    assert after.wisps is not None
    assert np.array_equal(after.wisps.owner, [0, 1, 2])


def test_strands_that_keep_their_owner_keep_their_way(crossed):
    uv = jnp.asarray(np.random.default_rng(1).uniform(size=(2000, 2)))
    after = part_tree(crossed, [MIDDLE])
    before, owner = find_owner(crossed, uv), find_owner(after, uv)
    eta = jnp.ones(2000)
    moved = grow_strands(after, uv, owner, eta, 7) - grow_strands(
        crossed, uv, before, eta, 7
    )
    far = jnp.linalg.norm(moved, axis=2).max(axis=1)
    same = (owner == before) & (owner >= 0)
    assert same.sum() > 500
    # The world's contours are 0.3 m wide; between two spokes shares are interpolated.
    assert jnp.all(jnp.where(same, far, 0.0) < 0.01)
    assert jnp.mean(jnp.where(same, far, 0.0)) < 0.002


def test_a_parting_cuts_chosen_clusters_only(crossed):
    after = part_tree(crossed, [MIDDLE], [1])
    assert jnp.array_equal(after.contour.offset[0], crossed.contour.offset[0])
    assert jnp.array_equal(after.cylinder.offset[0], crossed.cylinder.offset[0])
    assert jnp.any(after.contour.offset[1] != crossed.contour.offset[1])
    assert part_tree(crossed, []) is crossed
    assert part_tree(crossed, [MIDDLE], []) is crossed
