import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hairfit.model import (
    GeneralizedCylinder,
    HairTree,
    Scalp,
    ScalpContour,
    detail,
    sample_strands,
)
from hairfit.model.detail import Detail, cut_by_width, tree_of_cut, with_strands
from hairfit.model.maps import ScalpMaps
from hairfit.model.tree import leaves
from hairfit.model.wisp import Wisps

CIRCLES = [
    (0.3, 0.3, 0.2),
    (0.8, 0.8, 0.1),
    (0.2, 0.3, 0.05),
    (0.3, 0.3, 0.10),
    (0.4, 0.3, 0.05),
    (0.3, 0.32, 0.02),
    (0.3, 0.28, 0.06),
]
PARENT = [-1, -1, 0, 0, 0, 3, 3]
# 1 m in front of what stands at z = 0; 1 000 pixels a metre there.
CAMERA = np.array(
    [[1000.0, 0.0, 0.0, 0.0], [0.0, -1000.0, 0.0, 0.0], [0.0, 0.0, -1.0, 1.0]]
)


@pytest.fixture(scope="module")
def strands():
    """Curls of many sizes, in full detail."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 1.0, 81)[None]
    size, turns = rng.uniform(0.0, 0.03, (40, 1)), rng.uniform(0.0, 4.0, (40, 1))
    size[0] = 0.0  # straight
    x = size * np.cos(2.0 * np.pi * turns * t) + rng.uniform(-0.1, 0.1, (40, 1))
    z = size * np.sin(2.0 * np.pi * turns * t)
    return np.stack([x, np.broadcast_to(-0.3 * t, x.shape), z], axis=-1)


def to_pixels(points):
    at = points @ CAMERA[:, :3].T + CAMERA[:, 3]
    return at[..., :2] / at[..., 2:]


def furthest(points, polyline):
    """How far points are from a polyline at most, in 2D."""
    a, along = polyline[:-1], np.diff(polyline, axis=0)
    rest = points[:, None] - a[None]
    square = np.maximum((along * along).sum(axis=1), 1e-18)
    share = np.clip((rest * along[None]).sum(axis=2) / square, 0.0, 1.0)
    away = np.linalg.norm(rest - share[..., None] * along[None], axis=2)
    return away.min(axis=1).max()


def coarse(strand, segments):
    at = np.linspace(0.0, len(strand) - 1.0, segments + 1)
    return np.stack([np.interp(at, np.arange(len(strand)), x) for x in strand.T], 1)


@pytest.mark.parametrize("pixels", [0.1, 0.5, 3.0])
def test_the_segments_that_are_needed_keep_the_error(strands, pixels):
    segments = detail.segments_needed(strands, CAMERA, pixels)
    assert segments.min() == segments[0] == 1
    used = 0.0
    for strand, count in zip(strands, segments, strict=True):
        line = to_pixels(coarse(strand, int(count)))
        error = furthest(to_pixels(strand), line)
        assert error <= pixels
        used = max(used, error)
    assert used > 0.4 * pixels  # no more are asked for than make sense


def test_circles_need_segments_as_the_sagitta_has_it():
    angle = np.linspace(0.0, np.pi, 2001)
    half = 0.1 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    (found,) = detail.segments_needed(half[None], CAMERA, 0.5)
    # A chord over the angle a leaves a circle of 100 pixels by 100 (1 - cos(a / 2)).
    assert found == np.ceil(np.pi / (2.0 * np.arccos(1.0 - 0.5 / 100.0)))


def test_a_larger_error_or_distance_asks_for_fewer_segments(strands):
    found = [detail.segments_needed(strands, CAMERA, x) for x in (0.1, 0.3, 1.0, 5.0)]
    assert all((a >= b).all() for a, b in zip(found[:-1], found[1:], strict=True))
    assert found[0].sum() > 2 * found[-1].sum()
    away = detail.segments_needed(strands - np.array([0, 0, 3.0]), CAMERA, 0.1)
    assert (away <= found[0]).all() and away.sum() < found[0].sum()
    behind = strands + np.array([0.0, 0.0, 1.0])
    behind[:, 0, 2] = 2.0
    assert (detail.segments_needed(behind, CAMERA, 9.0) == 80).all()
    assert detail.segments_needed(strands[:, :1], CAMERA).tolist() == [1] * 40


@settings(max_examples=60, deadline=None)
@given(
    st.integers(1, 10**6),
    st.integers(1, 10**6),
    st.floats(0.01, 1.0),
    st.floats(1e-5, 1e-3),
)
def test_another_number_of_strands_covers_as_much(before, after, opacity, width):
    level = Detail(before, 30, opacity, width)
    other = with_strands(level, after)
    assert other.strands == after and other.segments == 30
    assert np.isclose(other.coverage, level.coverage, rtol=1e-9)
    # First opaque, then wide.
    assert other.opacity <= 1.0
    assert other.width == width or other.opacity == 1.0


def test_figure_4_23_trades_strands_for_opacity():
    fine = Detail(20_000, 60, 0.3, 0.0001)
    few = with_strands(fine, 5_000)
    assert few.opacity == 1.0 and np.isclose(few.width, 1.2e-4)


def test_coarser_levels_are_a_prefix_in_a_random_order():
    order = detail.fade_order(1000, jax.random.key(0))
    assert sorted(order.tolist()) == list(range(1000))
    # The first hundred are spread over all of them.
    assert np.histogram(order[:100], bins=4)[0].min() > 12
    assert np.array_equal(order, detail.fade_order(1000, jax.random.key(0)))
    assert not np.array_equal(order, detail.fade_order(1000, jax.random.key(1)))


@pytest.fixture
def tree(flat, make_tree):
    return make_tree(flat, CIRCLES, PARENT)


def test_the_width_of_a_straight_cluster_is_its_diameter(flat, make_tree):
    tree = make_tree(flat, [(0.5, 0.5, 0.05), (0.2, 0.4, 0.05)], [-1, -1])
    stand = jnp.stack([jnp.zeros(6), jnp.linspace(0.0, 0.3, 6), jnp.zeros(6)], axis=1)
    skeleton = jnp.stack([stand, stand - jnp.array([[0.0, 0.0, 1.0]])])
    tree = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton)
    radius = np.asarray(tree.cylinder.radius)[:, 0]
    width = detail.contour_widths(tree, CAMERA)
    # The nearest and the furthest points of a contour do not count for its width. The
    # circle is measured at 8 angles, so that it may look a little narrower.
    wide = 2000.0 * radius * np.array([1.0, 0.5])
    assert (width <= 1.01 * wide).all() and (width > 0.97 * wide).all()


def test_what_is_behind_the_camera_has_no_width_and_what_is_beside_it_any(tree):
    def at(z):
        move = jnp.array([[[0.0, 0.0, z]]])
        return eqx.tree_at(
            lambda t: t.cylinder.skeleton, tree, tree.cylinder.skeleton + move
        )

    assert (detail.contour_widths(at(50.0), CAMERA) == 0.0).all()
    assert np.isinf(detail.contour_widths(at(0.7), CAMERA)[0])


def below_or_same(tree, index):
    found = {index}
    for i, above in enumerate(tree.parent):
        if above in found:
            found.add(i)
    return found


def bare_tree(parent) -> HairTree:
    """Return a tree of which only the topology matters."""

    def zeros(*shape):
        return jnp.asarray(np.zeros((len(parent), *shape)))

    contour = jax.vmap(ScalpContour)(zeros(2), zeros(), zeros(32))
    knots, offset, scale = zeros(4), zeros(4, 32), zeros(4, 2)
    cylinder = jax.vmap(GeneralizedCylinder)(
        zeros(4, 3), zeros(3), knots, offset, scale, knots, knots
    )
    scalp = Scalp(jnp.asarray(np.zeros((13, 13, 3))))
    return HairTree(scalp, contour, cylinder, zeros(), tuple(parent))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 16), st.floats(0.0, 1.0))
def test_a_cut_has_one_cluster_above_each_leaf(seed, count, pixels):
    rng = np.random.default_rng(seed)
    tree = bare_tree([int(rng.integers(-1, i)) if i else -1 for i in range(count)])
    width = rng.uniform(0.0, 1.0, count)
    cut = detail.cut_at(tree, width <= pixels)
    assert cut.tolist() == sorted(set(cut.tolist()))
    for leaf in leaves(tree).tolist():
        way = [leaf]
        while tree.parent[way[-1]] >= 0:
            way.append(tree.parent[way[-1]])
        # The first on the way down that is narrow, or the leaf.
        first = next((i for i in reversed(way) if width[i] <= pixels), leaf)
        assert set(way) & set(cut.tolist()) == {first}
    coarser = detail.cut_at(tree, width <= 1.5 * pixels)
    assert len(coarser) <= len(cut)
    below = [below_or_same(tree, int(i)) for i in coarser]
    assert set(cut.tolist()) <= set().union(*below)


def test_cuts_go_from_the_leaves_to_the_root_clusters(tree):
    cuts = [cut_by_width(tree, CAMERA, x).tolist() for x in (1e-3, 1e6)]
    assert cuts == [leaves(tree).tolist(), [0, 1]]
    width = detail.contour_widths(tree, CAMERA)
    assert width[0] > width[3] > max(width[2], width[4], width[6])
    between = cut_by_width(tree, CAMERA, float(width[3]))
    assert between.tolist() == [1, 2, 3, 4] if width[1] <= width[3] else [2, 3, 4]
    counts = [len(cut_by_width(tree, CAMERA, x)) for x in np.geomspace(1.0, 2e3, 40)]
    assert counts == sorted(counts, reverse=True) and len(set(counts)) > 2


def test_hair_grows_from_the_tree_of_a_cut(tree):
    one = jnp.ones((2, 2))
    maps = ScalpMaps(one, one, one, jnp.ones((2, 2, 3)), one)
    wisps = Wisps(jnp.full((2, 2), 0.3), jnp.array([6, 4]), jnp.ones((2, 6, 3)))
    tree = eqx.tree_at(
        lambda t: (t.wisps, t.maps), tree, (wisps, maps), is_leaf=lambda x: x is None
    )
    few = tree_of_cut(tree, np.array([1, 2, 3, 4]))
    assert few.parent == (-1, -1, 0, 0, 0)
    assert np.array_equal(few.cylinder.skeleton, tree.cylinder.skeleton[:5])
    # The wisps of what is gone are gone too.
    assert few.wisps is not None and few.wisps.owner.tolist() == [4]
    assert eqx.tree_equal(few.maps, maps)
    hair = sample_strands(few, 20, 8, jax.random.key(0))
    assert hair.shape == (20, 8, 3) and np.isfinite(hair).all()


@pytest.mark.parametrize("cut", [[0], [0, 1, 2], [1, 2, 4, 5], []])
def test_what_is_no_cut_is_refused(tree, cut):
    with pytest.raises(ValueError, match=f"these {len(cut)} clusters are no cut"):
        tree_of_cut(tree, np.array(cut, int))


def test_sizes_that_are_not_positive_are_refused(tree, strands):
    with pytest.raises(ValueError, match="`pixels` must be positive, got 0"):
        cut_by_width(tree, CAMERA, 0.0)
    with pytest.raises(ValueError, match="`pixels` must be positive, got -1"):
        detail.segments_needed(strands, CAMERA, -1.0)
    with pytest.raises(ValueError, match="got 0 strands of 60 segments"):
        Detail(strands=0)
    with pytest.raises(ValueError, match="an opacity above 0 and up to 1"):
        Detail(opacity=1.5)
    with pytest.raises(ValueError, match="a positive width, got 0.3 and 0.0 m"):
        Detail(width=0.0)
