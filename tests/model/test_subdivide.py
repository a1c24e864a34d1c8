import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hairfit import model
from hairfit.model import (
    HairTree,
    ScalpContour,
    Wisps,
    cluster,
    contains,
    find_owner,
    grow_strands,
    sample_roots,
)
from hairfit.model.subdivide import (
    child_contours,
    owned_region,
    relax_centres,
    scatter_centres,
    subdivide,
    subdivide_into,
)

KEY = jax.random.key(3)
all_contain = jax.jit(
    lambda contours, uv: jax.vmap(
        lambda root: jax.vmap(contains, (0, None))(contours, root)
    )(uv)
)
on_scalp = jax.jit(jax.vmap(model.scalp_point, (None, 0)))


def straight(tree: HairTree, **values) -> HairTree:
    """Return the tree with straight skeletons, and cross-sections of given values."""
    cylinder, knots = tree.cylinder, tree.cylinder.skeleton.shape[1]
    along = jnp.linspace(0.0, 0.2, knots)[:, None] * jnp.array([[0.0, 1.0, 0.0]])
    values["skeleton"] = cylinder.skeleton[:, :1] + along[None]
    for name, value in values.items():
        old = getattr(cylinder, name)
        new = jnp.broadcast_to(jnp.asarray(value, float), old.shape)
        cylinder = eqx.tree_at(lambda c, n=name: getattr(c, n), cylinder, new)
    return eqx.tree_at(lambda t: t.cylinder, tree, cylinder)


def inside(contour: ScalpContour, count: int, seed: int = 0) -> jnp.ndarray:
    """Return random roots in a contour, not evenly."""
    rng = np.random.default_rng(seed)
    uv = jnp.asarray(rng.uniform(size=(20 * count, 2)))
    held = all_contain(model.stack([contour]), uv)[:, 0]
    return uv[held][:count]


def strands_of(tree: HairTree, uv) -> jnp.ndarray:
    return grow_strands(tree, uv, find_owner(tree, uv), jnp.ones(len(uv)), 11)


@pytest.fixture
def one(make_tree, flat) -> HairTree:
    return make_tree(flat, [(0.5, 0.5, 0.3)], [-1], variation=0.2)


def test_contours_are_scaled_by_the_root_of_the_number_of_children(one):
    after = subdivide(one, 0, 9, KEY, overlap=1.35)
    assert after.parent == (-1,) + (0,) * 9
    assert jnp.allclose(after.contour.radius[1:], 0.3 * 1.35 / 3)
    assert jnp.allclose(after.cylinder.radius[1:], one.cylinder.radius / 3)
    assert jnp.allclose(after.cylinder.offset[1:], one.cylinder.offset / 3, atol=1e-12)
    assert jnp.all(after.length_variation == 0.2)


def test_the_cluster_itself_stays_and_keeps_its_index(make_tree, dome):
    tree = make_tree(
        dome, [(0.3, 0.5, 0.3), (0.7, 0.5, 0.3), (0.3, 0.5, 0.2)], [-1, -1, 0]
    )
    after = subdivide(tree, 1, 5, KEY)
    before = model.take(after, np.arange(after.count) < 3)
    assert eqx.tree_equal(before, tree)


def test_skeletons_of_children_are_strands_of_the_cluster(make_tree, dome):
    tree = make_tree(dome, [(0.5, 0.5, 0.4)], [-1])
    after = subdivide(tree, 0, 6, KEY)
    centres = after.contour.centre[1:]
    eta, owner = jnp.ones(6), jnp.zeros(6, int)
    strands = grow_strands(tree, centres, owner, eta, 6)  # one point a knot
    assert jnp.allclose(after.cylinder.skeleton[1:], strands, atol=1e-12)


def test_contours_may_have_other_shapes(one):
    offset = 0.03 * jnp.cos(3.0 * jnp.arange(32.0) * (2 * jnp.pi / 32))
    contours = jax.vmap(ScalpContour)(
        jnp.array([[0.4, 0.5], [0.6, 0.5]]), jnp.full(2, 0.1), jnp.stack([offset] * 2)
    )
    after = subdivide_into(one, 0, contours)
    assert eqx.tree_equal(cluster(after.contour, 1), cluster(contours, 0))
    world = after.cylinder.radius[1] + after.cylinder.offset[1, 0, 0]
    whole = one.cylinder.radius[0] + one.cylinder.offset[0, 0, 0]
    assert jnp.allclose(world, whole * 0.13 / 0.3)


@pytest.mark.parametrize("borders", [(), ([[0.55, 0.0], [0.45, 1.0]],)])
def test_parallel_hair_stays_where_it_is_without_overlap(one, borders):
    tree = straight(one, scale=[[1.3, 0.6]], shear=0.4, twist=2.2)
    contour = cluster(tree.contour, 0)
    borders = [np.array(b) for b in borders]
    centres = relax_centres(tree.scalp, contour, inside(contour, 8), borders)
    contours = child_contours(tree.scalp, contour, centres, 1.0, borders)
    after = subdivide_into(tree, 0, contours)
    uv = inside(contour, 300)
    held = all_contain(contours, uv).any(axis=1)
    # At the knots, from the third one on: the way from the root to the second is bent.
    far = jnp.abs(strands_of(after, uv) - strands_of(tree, uv))[:, 4::2]
    assert held.mean() > 0.8
    # Beside a border, shares are interpolated between two spokes.
    limit = 0.02 if borders else 1e-12
    assert jnp.max(jnp.where(held[:, None, None], far, 0.0)) < limit
    assert jnp.mean(jnp.where(held[:, None, None], far, 0.0)) < max(0.1 * limit, 1e-12)


def test_hair_gathers_about_a_child_by_the_overlap(one):
    tree = straight(one, twist=0.7)
    after = subdivide(tree, 0, 7, KEY, overlap=1.5)
    uv = inside(cluster(tree.contour, 0), 300)
    owner = np.asarray(find_owner(after, uv))
    spine = after.cylinder.skeleton[owner, -1]
    tips, before = strands_of(after, uv)[:, -1], strands_of(tree, uv)[:, -1]
    held = all_contain(after.contour, uv)[np.arange(300), owner]
    gathered = (before - spine) / 1.5
    assert jnp.allclose(tips[held] - spine[held], gathered[held], atol=1e-12)


def test_hair_of_a_wound_cluster_stays_about_where_it_is(one):
    # Cross-sections of the children turn as their cluster's, not as their own frames.
    tree = straight(one, twist=np.linspace(0.0, 3.0, 6), scale=0.15)
    contour = cluster(tree.contour, 0)
    contours = child_contours(tree.scalp, contour, inside(contour, 8), 1.0)
    after = subdivide_into(tree, 0, contours)
    uv = inside(contour, 300)
    held = all_contain(contours, uv).any(axis=1)
    far = jnp.linalg.norm(strands_of(after, uv) - strands_of(tree, uv), axis=2)
    width = 0.3 * 0.15 / 8**0.5  # of a child
    assert jnp.mean(far[held][:, 2:]) < 0.2 * width


def test_children_lie_in_the_contour_evenly(one, flat):
    contour = cluster(one.contour, 0)
    random = scatter_centres(flat, contour, 16, KEY)
    even = relax_centres(flat, contour, random)
    assert all_contain(model.stack([contour]), random).all()
    assert all_contain(model.stack([contour]), even).all()

    def closest(uv):
        apart = np.linalg.norm(uv[:, None] - uv[None], axis=2)
        return (apart + np.eye(len(uv))).min(axis=1)

    # What 16 points in a pattern of triangles would have.
    pattern = np.sqrt(2 / np.sqrt(3) * np.pi * 0.3**2 / 16)
    assert closest(np.asarray(random)).min() < 0.4 * pattern
    assert closest(np.asarray(even)).min() > 0.7 * pattern

    roots = inside(contour, 4000)
    covered = [
        all_contain(child_contours(flat, contour, c), roots).any(axis=1).mean()
        for c in (random, even)
    ]
    assert covered[0] < 0.93 < 0.985 < covered[1]


def test_positions_are_even_in_metres_where_the_patch_is_not(make_tree, flat):
    # u runs to the square root of the way: one end is stretched, the other pressed.
    side = jnp.linspace(0.0, 1.0, 13)
    stretched = eqx.tree_at(
        lambda s: s.control, flat, flat.control.at[..., 2].set(side[:, None] ** 2)
    )
    contour = ScalpContour(jnp.array([0.5, 0.5]), jnp.array(0.45), jnp.zeros(32))
    random = scatter_centres(stretched, contour, 400, KEY)
    p = np.asarray(on_scalp(stretched, random))
    roots = sample_roots(stretched, 8000, KEY)
    held = all_contain(model.stack([contour]), roots)[:, 0]
    want = np.asarray(on_scalp(stretched, roots))[held].mean(axis=0)
    assert np.allclose(p.mean(axis=0), want, atol=0.03)

    p = on_scalp(stretched, relax_centres(stretched, contour, random[:16]))
    apart = np.linalg.norm(p[:, None] - p[None], axis=2) + np.eye(16)
    closest = apart.min(axis=1)
    assert closest.max() < 2.2 * closest.min()
    contours = child_contours(stretched, contour, random[:16])
    by_u = jnp.argsort(random[:16, 0])
    assert jnp.all(jnp.diff(contours.radius[by_u]) <= 1e-12)
    assert jnp.allclose(jnp.mean(contours.radius**2), (0.45 * 1.4) ** 2 / 16, rtol=0.1)


def test_points_at_one_place_are_no_trouble(one, flat):
    same = jnp.full((5, 2), 0.5)
    even = relax_centres(flat, cluster(one.contour, 0), same, [np.eye(2)])
    assert jnp.all(jnp.isfinite(even))


def test_one_child_stands_in_its_cluster(one):
    after = subdivide(one, 0, 1, KEY)
    assert after.parent == (-1, 0)
    assert contains(cluster(one.contour, 0), after.contour.centre[1])


@st.composite
def grown(draw):
    """Draw circles, their parents, and which leaf is subdivided into how many."""
    rng = np.random.default_rng(draw(st.integers(0, 2**31)))
    count = 4
    parent = [int(rng.integers(-1, i)) for i in range(count)]
    rows = rng.uniform([0.2, 0.2, 0.05], [0.8, 0.8, 0.4], (count, 3))
    leaf = draw(st.sampled_from(sorted(set(range(count)) - set(parent))))
    return (
        rows,
        parent,
        leaf,
        draw(st.sampled_from([1, 2, 5])),
        draw(st.integers(0, 99)),
    )


@settings(
    max_examples=25,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(case=grown())
def test_subdividing_loses_no_strand(make_tree, dome, case):
    rows, parent, leaf, count, seed = case
    tree = make_tree(dome, rows, parent)
    uv = jnp.asarray(np.random.default_rng(seed).uniform(size=(500, 2)))
    after = subdivide(tree, leaf, count, jax.random.key(seed))
    before, owner = np.asarray(find_owner(tree, uv)), np.asarray(find_owner(after, uv))
    assert np.array_equal(before >= 0, owner >= 0)
    changed = owner != before
    if parent[leaf] < 0:
        assert np.array_equal(changed, before == leaf)
    # What no leaf contains may change hands, but only from or to the subdivided one.
    assert np.all(owner[changed & (before != leaf)] >= tree.count)


def test_no_child_crosses_a_border(make_tree, dome):
    tree = make_tree(dome, [(0.5, 0.5, 0.42)], [-1])
    border = np.array([[0.45, -0.5], [0.55, 0.5], [0.45, 1.5]])
    after = subdivide(tree, 0, 12, KEY, borders=[border])
    again = subdivide(after, 1, 4, KEY, borders=[border])
    uv = np.asarray(sample_roots(dome, 5000, KEY))

    def right_of(uv):
        return uv[:, 0] > np.interp(uv[:, 1], border[:, 1], border[:, 0])

    for one in (after, again):
        owner = np.asarray(find_owner(one, uv))
        held = owner >= 0
        side = right_of(np.asarray(one.contour.centre))[owner]
        assert np.mean(side[held] == right_of(uv)[held]) > 0.997
    centres = np.asarray(after.contour.centre)[1:]
    assert 4 <= right_of(centres).sum() <= 8
    off = np.abs(centres[:, 0] - np.interp(centres[:, 1], border[:, 1], border[:, 0]))
    assert off.min() > 0.03


def test_children_stand_where_the_cluster_owns_roots(make_tree, flat):
    tree = make_tree(flat, [(0.35, 0.5, 0.3), (0.65, 0.5, 0.3)], [-1, -1])
    region = owned_region(tree, 0)
    # The middle between the two is 0.15 away, to the right.
    assert jnp.allclose(region.radius + region.offset[0], 0.15, atol=0.3 / 24)
    assert jnp.allclose(region.radius + region.offset[16], 0.3)
    after = subdivide(tree, 0, 8, KEY)
    assert jnp.all(after.contour.centre[2:, 0] < 0.5)
    uv = np.random.default_rng(0).uniform(size=(4000, 2))
    assert set(range(2, 10)) <= set(np.asarray(find_owner(after, uv)).tolist())


def test_a_cluster_without_its_centre_is_subdivided_all_the_same(make_tree, flat):
    tree = make_tree(flat, [(0.5, 0.5, 0.2), (0.5, 0.5, 0.3)], [-1, -1])
    region = owned_region(tree, 1)
    assert eqx.tree_equal(region, cluster(tree.contour, 1))
    assert subdivide(tree, 1, 3, KEY).count == 5


def test_wisps_move_to_the_children_and_maps_stay(one):
    uv = inside(cluster(one.contour, 0), 20)
    even = jnp.ones((2, 2))
    maps = model.ScalpMaps(even, even, even, jnp.ones((2, 2, 3)), even)
    wisps = Wisps(uv, jnp.zeros(20, int), jnp.zeros((20, 6, 3)))
    tree = HairTree(
        one.scalp,
        one.contour,
        one.cylinder,
        one.length_variation,
        one.parent,
        wisps,
        maps,
    )
    after = subdivide(tree, 0, 4, KEY)
    assert after.wisps is not None
    assert np.array_equal(after.wisps.owner, find_owner(after, uv))
    assert eqx.tree_equal(after.maps, maps)


def test_the_same_key_gives_the_same_children_and_another_one_others(one):
    first, second = subdivide(one, 0, 5, KEY), subdivide(one, 0, 5, KEY)
    other = subdivide(one, 0, 5, jax.random.key(4))
    assert eqx.tree_equal(first, second)
    assert not eqx.tree_equal(first, other)


def test_float32_stays_float32(one):
    tree = jax.tree.map(lambda x: x.astype(jnp.float32), one)
    border = np.array([[0.5, 0.0], [0.5, 1.0]])
    after = subdivide(tree, 0, 5, KEY, borders=[border])
    assert {leaf.dtype for leaf in jax.tree.leaves(after)} == {jnp.dtype("float32")}


def test_a_cluster_with_children_is_refused(make_tree, flat):
    tree = make_tree(flat, [(0.5, 0.5, 0.3), (0.5, 0.5, 0.1)], [-1, 0])
    with pytest.raises(ValueError, match="has 1 children already.*`drop_descendants`"):
        subdivide(tree, 0, 3, KEY)
    with pytest.raises(ValueError, match="has 1 children already"):
        subdivide_into(tree, 0, tree.contour)


@pytest.mark.parametrize("index", [-1, 1])
def test_a_cluster_that_is_not_there_is_refused(one, index):
    with pytest.raises(ValueError, match=f"no cluster {index} to subdivide"):
        subdivide(one, index, 3, KEY)


def test_no_children_are_refused(one):
    with pytest.raises(ValueError, match="1 child or more, got a count of 0"):
        subdivide(one, 0, 0, KEY)


@pytest.mark.parametrize("circle", [(0.5, 0.5, 0.0), (1.6, 0.5, 0.3)])
def test_a_contour_off_the_scalp_is_refused(make_tree, flat, circle):
    tree = make_tree(flat, [circle], [-1])
    with pytest.raises(ValueError, match="hardly any area on the scalp"):
        subdivide(tree, 0, 3, KEY)
