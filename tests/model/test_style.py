import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from hairfit.model import (
    HairTree,
    ScalpContour,
    Wisps,
    children,
    cluster,
    descendants,
    find_owner,
    grow_strands,
    leaves,
    local_coordinates,
    scalp_point,
)
from hairfit.model.bind import bind_points
from hairfit.model.curve import catmull_rom_weights
from hairfit.model.cylinder import cylinder_knots
from hairfit.model.style import (
    ALL,
    PARTS,
    copy_style,
    extract_style,
    moved_contour,
    moved_root,
    paste_style,
    resample_knots,
)

# Two root clusters, one of which has two children, one of which has a child.
CIRCLES = [
    (0.3, 0.3, 0.1),
    (0.7, 0.6, 0.2),
    (0.26, 0.3, 0.05),
    (0.34, 0.31, 0.06),
    (0.34, 0.32, 0.03),
]
PARENT = (-1, -1, 0, 0, 3)
A, B = 0, 1

on_scalp = jax.jit(jax.vmap(scalp_point, (None, 0)))
around = jax.jit(jax.vmap(jax.vmap(cylinder_knots, (None, None, 0)), (0, None, None)))
locate = jax.jit(jax.vmap(local_coordinates, (None, 0)))


@pytest.fixture
def styled(flat, make_tree) -> HairTree:
    """A flat scalp's tree whose roots stand on it, with wisps."""
    tree = make_tree(flat, CIRCLES, PARENT, variation=0.1)
    shift = on_scalp(flat, tree.contour.centre) - tree.cylinder.skeleton[:, 0]
    skeleton = tree.cylinder.skeleton + shift[:, None]
    variation = jnp.array([0.1, 0.2, 0.3, 0.4, 0.5])
    rng = np.random.default_rng(5)
    wisps = Wisps(
        jnp.array([[0.25, 0.31], [0.34, 0.33], [0.72, 0.6]]),
        jnp.array([2, 4, 1]),
        jnp.asarray(0.01 * rng.normal(size=(3, 6, 3))),
    )
    tree = eqx.tree_at(
        lambda t: (t.cylinder.skeleton, t.length_variation), tree, (skeleton, variation)
    )
    return dataclasses.replace(tree, wisps=wisps)


def straight(tree: HairTree, some=(A, B)) -> HairTree:
    """Return the tree of which some clusters stand upright, without twist."""
    up = jnp.linspace(0.0, 0.2, 6)[:, None] * jnp.array([[0.0, 1.0, 0.0]])
    skeleton, twist = tree.cylinder.skeleton, tree.cylinder.twist
    for i in some:
        skeleton = skeleton.at[i].set(skeleton[i, :1] + up)
        twist = twist.at[i].set(0.0)
    return eqx.tree_at(
        lambda t: (t.cylinder.skeleton, t.cylinder.twist), tree, (skeleton, twist)
    )


def outlines(tree: HairTree) -> jax.Array:
    """Return points of all contours in the world: clusters, angles, knots, 3."""
    return around(tree.cylinder, 1.0, jnp.linspace(0.0, 6.0, 7))


def assert_same(one, other, atol=1e-9):
    assert jax.tree.structure(one) == jax.tree.structure(other)
    for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
        assert jnp.allclose(a, b, rtol=0.0, atol=atol)


def test_an_extracted_style_is_a_tree_with_one_root_cluster(styled):
    template = extract_style(styled, A)
    assert template.parent == (-1, 0, 0, 2)
    assert template.wisps is not None
    assert template.wisps.owner.tolist() == [1, 3]
    assert_same(cluster(template.cylinder, 3), cluster(styled.cylinder, 4))
    deep = extract_style(styled, 3)
    assert deep.parent == (-1, 0)
    assert_same(cluster(deep.contour, 0), cluster(styled.contour, 3))


def test_a_copy_has_the_clusters_of_its_source_below_it(styled):
    copied = copy_style(styled, A, B)
    assert copied.parent == (*PARENT, 1, 1, 6)
    assert copied.count == styled.count + 3
    assert copied.length_variation.tolist() == pytest.approx(
        [0.1, 0.1, 0.3, 0.4, 0.5, 0.3, 0.4, 0.5]
    )
    for i in (A, 2, 3, 4):
        assert_same(cluster(copied.cylinder, i), cluster(styled.cylinder, i))
    # The target keeps the way that it runs, and where it is rooted.
    assert jnp.array_equal(copied.cylinder.skeleton[B], styled.cylinder.skeleton[B])
    assert_same(cluster(copied.contour, B), cluster(styled.contour, B))


def test_what_was_below_the_target_is_replaced(styled):
    once = copy_style(styled, 3, A)
    assert once.parent == (-1, -1, 0)
    assert jnp.allclose(once.cylinder.twist[2], styled.cylinder.twist[4], atol=1.0)
    emptied = copy_style(styled, B, A)
    assert emptied.parent == (-1, -1)


def test_clusters_keep_their_coordinates_in_the_new_parent(styled):
    """What 4.6.2 says: bound to the source, updated with the target."""
    # Both stand upright on the flat scalp, where roots are at t = 0, and then bend.
    late = jnp.maximum(jnp.linspace(0.0, 1.0, 6) - 0.25, 0.0) ** 2
    tree = straight(styled)
    skeleton = tree.cylinder.skeleton.at[A, :, 0].add(0.05 * late)
    skeleton = skeleton.at[B, :, 2].add(-0.15 * late)
    tree = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton)
    copied = copy_style(tree, A, B)
    for old, new in ((2, 5), (3, 6), (4, 7)):
        was = bind_points(cluster(tree.cylinder, A), tree.cylinder.skeleton[old])
        now = bind_points(cluster(copied.cylinder, B), copied.cylinder.skeleton[new])
        some = ~(was.ambiguous | now.ambiguous)
        assert some.sum() >= 4
        assert jnp.allclose(was.t[some], now.t[some], atol=1e-6)
        assert jnp.allclose(was.r[some], now.r[some], rtol=1e-5, atol=1e-6)


def test_on_twins_a_copy_is_a_scaled_and_moved_one(styled):
    """Upright twins on a flat scalp, the target twice as wide: a closed form."""
    tree = straight(styled, (A, B, 2, 3, 4))
    copied = copy_style(tree, A, B)
    root = np.asarray(tree.cylinder.skeleton[:, 0])
    before = np.asarray(outlines(tree))[[2, 3, 4]] - root[A]
    after = np.asarray(outlines(copied))[[5, 6, 7]] - root[B]
    assert np.allclose(after, before * [2.0, 1.0, 2.0], atol=1e-9)
    # The contours are scaled, the scales are not.
    radius = copied.cylinder.radius
    assert jnp.allclose(radius[5], 2.0 * radius[2], rtol=1e-9)


def test_children_tile_the_target_as_they_tile_the_source(styled):
    rng = np.random.default_rng(0)
    contour = eqx.tree_at(
        lambda c: c.offset,
        styled.contour,
        styled.contour.offset
        + jnp.asarray(0.02 * np.cos(np.arange(32) * np.pi / 8 + 1.0))[None],
    )
    tree = eqx.tree_at(lambda t: t.contour, styled, contour)
    copied = copy_style(tree, A, B)
    share, angle = rng.uniform(size=600), rng.uniform(0.0, 2.0 * np.pi, 600)
    spoke = 0.09 * share[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
    uv = contour.centre[A][None] + jnp.asarray(spoke)
    moved = jax.vmap(moved_root, (None, None, 0))(
        cluster(contour, A), cluster(contour, B), uv
    )
    local = locate(cluster(contour, A), uv)
    there = locate(cluster(contour, B), moved)
    assert jnp.allclose(local.r, there.r, atol=1e-12)
    was, now = np.asarray(find_owner(tree, uv)), np.asarray(find_owner(copied, moved))
    number = {2: 5, 4: 7}
    mine = np.isin(was, list(number))
    same = now[mine] == np.array([number[int(i)] for i in was[mine]])
    assert mine.sum() > 400
    assert same.mean() > 0.95  # but for what distances decide in overlaps


def test_roots_of_the_copies_stand_on_the_scalp(dome, make_tree):
    tree = make_tree(dome, CIRCLES, PARENT)
    copied = copy_style(tree, A, B)
    new = descendants(copied, B)
    root = on_scalp(dome, copied.contour.centre[new])
    assert jnp.allclose(copied.cylinder.skeleton[new, 0], root, atol=1e-12)


def test_a_template_pasted_where_it_was_taken_changes_nothing(styled):
    template = extract_style(styled, A)
    again = paste_style(styled, template, A)
    assert again.parent == (-1, -1, 0, 0, 3)
    assert_same(again.cylinder, styled.cylinder)
    assert_same(again.contour, styled.contour)
    assert again.wisps is not None
    assert styled.wisps is not None
    order = jnp.array([2, 0, 1])  # those of the template come last
    assert_same(jax.tree.map(lambda x: x[order], styled.wisps), again.wisps)


@settings(
    max_examples=6,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(source=st.integers(0, 4), target=st.integers(0, 4))
def test_any_cluster_is_copied_onto_any_other_but_below_itself(styled, source, target):
    if target == source or target in descendants(styled, source):
        with pytest.raises(ValueError, match="cannot be copied onto|lies below"):
            copy_style(styled, source, target)
        return
    copied = copy_style(styled, source, target)
    gone, added = descendants(styled, target), descendants(styled, source)
    assert copied.count == styled.count - len(gone) + len(added)
    assert len(children(copied, target)) == len(children(styled, source))
    assert all(jnp.all(jnp.isfinite(x)) for x in jax.tree.leaves(copied))
    owner = find_owner(copied, on_grid())
    assert set(np.asarray(owner)) <= {-1, *leaves(copied)}


def on_grid() -> np.ndarray:
    side = np.linspace(0.1, 0.9, 12)
    return np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("part", ["scale", "twist", "shear", "length_variation"])
def test_one_parameter_alone_is_copied(styled, part):
    rng = np.random.default_rng(2)
    tree = eqx.tree_at(
        lambda t: (t.cylinder.scale, t.cylinder.shear),
        styled,
        (
            jnp.asarray(rng.uniform(0.5, 1.5, size=(5, 6, 2))),
            jnp.asarray(rng.normal(size=(5, 6)) * 0.1),
        ),
    )
    copied = copy_style(tree, A, B, what={part})
    assert copied.parent == tree.parent
    for name in ("scale", "twist", "shear", "skeleton", "radius", "offset"):
        source = A if name == part else B
        expected = getattr(tree.cylinder, name)[source]
        assert jnp.allclose(getattr(copied.cylinder, name)[B], expected, atol=1e-12)
    source = A if part == "length_variation" else B
    assert copied.length_variation[B] == tree.length_variation[source]
    assert_same(copied.contour, tree.contour)


def test_what_a_patch_does_to_planted_clusters_is_not_copied(dome, make_tree):
    """On a patch that is not conformal, planted clusters have scales and shears."""
    circles = [(0.2, 0.3, 0.1), (0.6, 0.9, 0.1)]
    tree = make_tree(dome, circles, (-1, -1))
    assert not jnp.allclose(*tree.cylinder.scale[:, 0], atol=0.05)
    copied = copy_style(tree, 0, 1)
    assert jnp.allclose(copied.cylinder.scale[1], tree.cylinder.scale[1], atol=1e-12)
    assert jnp.allclose(copied.cylinder.shear[1], tree.cylinder.shear[1], atol=1e-12)
    assert jnp.array_equal(copied.cylinder.twist[1], tree.cylinder.twist[0])


def test_without_children_those_of_the_target_stay_and_follow(styled):
    tree = straight(styled)
    turn = jnp.linspace(0.0, 2.0, 6)
    tree = eqx.tree_at(
        lambda t: t.cylinder.twist, tree, tree.cylinder.twist.at[B].set(turn)
    )
    twisted = copy_style(tree, B, A, what="twist")
    assert twisted.parent == tree.parent
    assert jnp.allclose(twisted.cylinder.twist[A], turn)
    # About the upright axis of A its child's knots turn by the twist there.
    axis = tree.cylinder.skeleton[A, :1]
    was, now = (t.cylinder.skeleton[2] - axis for t in (tree, twisted))
    at = bind_points(cluster(tree.cylinder, A), tree.cylinder.skeleton[2]).t
    angle = jnp.interp(at, jnp.linspace(0.0, 1.0, 6), turn)
    # From the normal (+x) to the binormal (-z), seen along +y.
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    x = cos * was[:, 0] + sin * was[:, 2]
    z = -sin * was[:, 0] + cos * was[:, 2]
    inner = slice(1, 5)
    expected = jnp.stack([x, was[:, 1], z], axis=1)
    assert jnp.allclose(now[inner], expected[inner], atol=1e-6)


def test_a_contour_is_copied_in_the_ratio_of_the_contours_at_the_root(styled):
    taper = jnp.linspace(1.0, 0.3, 6)
    tree = eqx.tree_at(
        lambda t: t.cylinder.radius, styled, styled.cylinder.radius * taper[None]
    )
    tree = eqx.tree_at(
        lambda t: t.cylinder.radius,
        tree,
        tree.cylinder.radius.at[B].set(tree.cylinder.radius[B, 0]),
    )
    copied = copy_style(tree, A, B, what={"contour"})
    expected = tree.cylinder.radius[B, 0] * taper
    assert jnp.allclose(copied.cylinder.radius[B], expected, atol=1e-12)
    assert_same(copied.contour, tree.contour)


def test_a_skeleton_is_copied_when_asked_for(styled):
    tree = straight(styled)
    bent = tree.cylinder.skeleton.at[A, :, 0].add(0.05 * jnp.linspace(0.0, 1.0, 6) ** 2)
    tree = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, bent)
    copied = copy_style(tree, A, B, what={"skeleton"})
    shape = copied.cylinder.skeleton[B] - copied.cylinder.skeleton[B, :1]
    assert jnp.allclose(shape, bent[A] - bent[A, :1], atol=1e-12)
    root = tree.cylinder.skeleton[B, 0]
    assert jnp.allclose(copied.cylinder.skeleton[B, 0], root, atol=1e-12)
    assert "skeleton" not in ALL


def test_wisps_are_copied_at_the_size_of_the_target(styled):
    tree = straight(styled, (A, B, 2, 3, 4))
    copied = copy_style(tree, A, B)
    assert copied.wisps is not None
    assert tree.wisps is not None
    # Two of the source, and two copies: the target's own one is replaced.
    assert copied.wisps.owner.tolist() == [2, 4, 5, 7]
    middle = tree.contour.centre
    moved = middle[B][None] + 2.0 * (tree.wisps.uv[:2] - middle[A][None])
    assert jnp.allclose(copied.wisps.uv[2:], moved, atol=1e-12)
    assert jnp.allclose(copied.wisps.offset[2:], 2.0 * tree.wisps.offset[:2])


def test_without_wisps_those_of_the_target_stay(styled):
    copied = copy_style(styled, A, B, what=ALL - {"wisps"})
    assert copied.wisps is not None
    assert styled.wisps is not None
    assert len(copied.wisps.owner) == 3
    assert jnp.array_equal(copied.wisps.uv, styled.wisps.uv)
    assert int(copied.wisps.owner[2]) in descendants(copied, B)


def test_wisps_alone_go_to_the_leaves_that_own_their_roots(styled):
    copied = copy_style(styled, A, B, what={"wisps"})
    assert copied.parent == styled.parent
    assert copied.wisps is not None
    assert copied.wisps.owner.tolist() == [2, 4, 1, 1]


def test_strands_grow_from_a_copy(styled):
    copied = copy_style(styled, A, B)
    uv = copied.contour.centre[7][None] + jnp.array([[0.0, 0.0], [0.005, 0.0]])
    owner = find_owner(copied, uv)
    assert owner.tolist() == [7, 7]
    strands = grow_strands(copied, uv, owner, jnp.ones(2), 9)
    assert jnp.all(jnp.isfinite(strands))


def test_a_template_with_more_knots_refines_the_tree(styled):
    template = resample_knots(extract_style(styled, 4), 11)
    pasted = paste_style(styled, template, B)
    assert pasted.cylinder.skeleton.shape == (5, 11, 3)
    assert_same(pasted.cylinder.skeleton[:, ::2], styled.cylinder.skeleton)
    twist = jnp.interp(
        jnp.linspace(0, 5, 11), jnp.arange(6.0), styled.cylinder.twist[4]
    )
    assert jnp.allclose(pasted.cylinder.twist[B], twist)
    coarse = paste_style(resample_knots(styled, 11), extract_style(styled, 4), B)
    assert_same(coarse.cylinder, pasted.cylinder)


def test_resampled_skeletons_lie_on_the_same_curves(styled):
    fine = resample_knots(styled, 11)  # every other knot is an old one
    assert jnp.allclose(fine.cylinder.skeleton[:, ::2], styled.cylinder.skeleton)
    middle = catmull_rom_weights(6, jnp.array([0.1])) @ styled.cylinder.skeleton[2]
    assert jnp.allclose(fine.cylinder.skeleton[2, 1], middle[0])
    halfway = 0.5 * (styled.cylinder.twist[:, 0] + styled.cylinder.twist[:, 1])
    assert jnp.allclose(fine.cylinder.twist[:, 1], halfway)
    assert fine.wisps is not None
    assert fine.wisps.offset.shape == (3, 11, 3)
    assert_same(resample_knots(fine, 6).cylinder, styled.cylinder)
    assert resample_knots(styled, 6) is styled


def test_a_contour_moved_between_circles_is_scaled():
    def circle(u, v, radius):
        return ScalpContour(jnp.array([u, v]), jnp.asarray(radius), jnp.zeros(32))

    offset = jnp.asarray(0.01 * np.sin(np.arange(32)))
    child = ScalpContour(jnp.array([0.33, 0.28]), jnp.asarray(0.05), offset)
    moved = moved_contour(circle(0.3, 0.3, 0.1), circle(0.6, 0.5, 0.25), child)
    assert jnp.allclose(moved.centre, jnp.array([0.675, 0.45]))
    assert jnp.allclose(
        moved.radius + moved.offset, 2.5 * (child.radius + child.offset)
    )


def test_moved_contours_have_gradients(styled):
    def reach(centre, offset):
        contour = ScalpContour(centre, jnp.asarray(0.05), offset)
        a, b = cluster(styled.contour, A), cluster(styled.contour, B)
        return moved_contour(a, b, contour).offset

    start = jnp.array([0.32, 0.29]), 0.003 * jnp.cos(jnp.arange(32.0))
    check_grads(jax.jit(reach), start, order=1, modes=["rev"])
    at_centre = jax.jit(jax.grad(lambda c: reach(c, jnp.zeros(32)).sum()))
    assert jnp.all(jnp.isfinite(at_centre(styled.contour.centre[A])))


@pytest.mark.slow  # the programs are compiled once more
def test_single_precision_is_kept(styled):
    single = jax.tree.map(
        lambda x: x.astype(jnp.float32) if x.dtype == jnp.float64 else x, styled
    )
    copied = copy_style(single, A, B)
    for leaf in jax.tree.leaves((copied.cylinder, copied.contour)):
        assert leaf.dtype == jnp.float32
    mixed = paste_style(single, extract_style(styled, A), B)
    assert mixed.cylinder.skeleton.dtype == jnp.float32


def test_a_copy_onto_itself_is_refused(styled):
    with pytest.raises(ValueError, match="cluster 0 cannot be copied onto itself"):
        copy_style(styled, A, A)


def test_a_copy_into_its_own_descendants_is_refused(styled):
    with pytest.raises(ValueError, match="cluster 4 lies below cluster 0"):
        copy_style(styled, A, 4)


def test_clusters_that_are_not_there_are_refused(styled):
    with pytest.raises(ValueError, match="no cluster 9; the tree has clusters 0 to 4"):
        copy_style(styled, 9, 0)
    with pytest.raises(ValueError, match="no cluster -1"):
        copy_style(styled, 0, -1)


def test_parts_that_are_not_there_are_refused(styled):
    with pytest.raises(ValueError, match=f"no colour, tilt; .*{PARTS[-1]}"):
        copy_style(styled, A, B, what={"tilt", "scale", "colour"})


def test_a_template_of_many_root_clusters_is_refused(styled):
    with pytest.raises(ValueError, match="one root cluster, got 2"):
        paste_style(styled, styled, B)


def test_fewer_than_two_knots_are_refused(styled):
    with pytest.raises(ValueError, match="at least 2 knots, got 1"):
        resample_knots(styled, 1)
