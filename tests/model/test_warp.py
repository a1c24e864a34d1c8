import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hairfit.model import HairTree, Scalp, Wisps, grow_strands, scalp_point
from hairfit.model.collide import field_distance, sample_field
from hairfit.model.curve import arc_length, catmull_rom_weights
from hairfit.model.cylinder import cylinder_knots
from hairfit.model.warp import (
    align_scalp,
    correspondences,
    head_warp,
    scalp_size,
    transfer,
    warp_derivatives,
    warp_points,
)

CIRCLES = [(0.3, 0.4, 0.2), (0.7, 0.6, 0.2), (0.35, 0.45, 0.1)]
PARENT = (-1, -1, 0)
on_scalp = jax.jit(jax.vmap(scalp_point, (None, 0)))
around = jax.jit(jax.vmap(jax.vmap(cylinder_knots, (None, None, 0)), (0, None, None)))


@pytest.fixture
def haired(dome, make_tree) -> HairTree:
    """A tree rooted on the dome, with wisps."""
    tree = make_tree(dome, CIRCLES, PARENT)
    shift = on_scalp(dome, tree.contour.centre) - tree.cylinder.skeleton[:, 0]
    tree = eqx.tree_at(
        lambda t: t.cylinder.skeleton, tree, tree.cylinder.skeleton + shift[:, None]
    )
    rng = np.random.default_rng(3)
    wisps = Wisps(
        jnp.array([[0.35, 0.45], [0.7, 0.62]]),
        jnp.array([2, 1]),
        jnp.asarray(0.002 * rng.normal(size=(2, 6, 3))),
    )
    return dataclasses.replace(tree, wisps=wisps)


def rotation(angle: float) -> np.ndarray:
    """Return a rotation about a slanted axis."""
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    skew = np.cross(np.eye(3), axis)
    return np.eye(3) - np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew


def outlines(tree: HairTree) -> jax.Array:
    """Return points of all contours in the world: clusters, angles, knots, 3."""
    return around(tree.cylinder, 1.0, jnp.linspace(0.0, 6.0, 7))


def wide(scalp: Scalp) -> Scalp:
    """Return a scalp that is wider, and bulges on one side."""
    p = np.asarray(scalp.control) * [1.2, 1.05, 0.95]
    bulge = 0.1 * np.exp(-((p - p[9, 4]) ** 2).sum(-1) / 0.04**2)
    return Scalp(jnp.asarray(p * (1.0 + bulge)[..., None]))


def strands_of(tree: HairTree) -> jax.Array:
    uv = jnp.array([[0.36, 0.46], [0.3, 0.43], [0.75, 0.6], [0.7, 0.7]])
    owner = jnp.array([2, 2, 1, 1])
    return grow_strands(tree, uv, owner, jnp.ones(4), 21)


def test_a_tree_transferred_to_its_own_head_does_not_change(haired):
    same = transfer(haired, haired.scalp)
    for before, after in zip(
        jax.tree.leaves(haired), jax.tree.leaves(same), strict=True
    ):
        assert jnp.allclose(before, after, rtol=0.0, atol=1e-9)
    kept = transfer(haired, haired.scalp, keep_lengths=True)
    assert jnp.allclose(kept.cylinder.skeleton, haired.cylinder.skeleton, atol=1e-9)


@settings(
    max_examples=10,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(size=st.floats(0.3, 3.0), angle=st.floats(-3.0, 3.0), shift=st.floats(-1.0, 1.0))
def test_a_head_moved_and_scaled_takes_its_hair_along(haired, size, angle, shift):
    tree = haired
    turn = size * jnp.asarray(rotation(angle))
    scalp = Scalp(tree.scalp.control @ turn.T + shift)
    there = transfer(tree, scalp)
    assert jnp.allclose(outlines(there), outlines(tree) @ turn.T + shift, atol=1e-8)
    assert jnp.allclose(strands_of(there), strands_of(tree) @ turn.T + shift, atol=1e-8)
    # The size is in the contours; scale, twist and shear say shape alone.
    assert jnp.allclose(there.cylinder.radius, size * tree.cylinder.radius, atol=1e-9)
    for name in ("scale", "twist", "shear"):
        was, now = getattr(tree.cylinder, name), getattr(there.cylinder, name)
        assert jnp.allclose(was, now, atol=1e-6)


def test_landmarks_move_with_the_head_as_well(haired):
    turn = 1.3 * jnp.asarray(rotation(0.7))
    face = np.random.default_rng(0).normal(size=(20, 3)) * 0.05 + [0.0, -0.1, 0.08]
    scalp = Scalp(haired.scalp.control @ turn.T)
    there = transfer(haired, scalp, from_points=face, to_points=face @ np.array(turn.T))
    assert jnp.allclose(outlines(there), outlines(haired) @ turn.T, atol=1e-8)


def test_roots_stand_on_the_new_scalp_and_keep_their_place(haired):
    other = wide(haired.scalp)
    there = transfer(haired, other)
    centre = haired.contour.centre
    assert jnp.array_equal(there.contour.centre, centre)
    root = on_scalp(other, centre)
    assert jnp.allclose(there.cylinder.skeleton[:, 0], root, atol=1e-12)
    assert jnp.array_equal(there.scalp.control, other.control)
    assert there.parent == haired.parent


def test_content_follows_the_derivative_of_the_warp(haired):
    """What a cluster holds moves as the space around its skeleton does."""
    other = wide(haired.scalp)
    pairs = correspondences(haired.scalp, other)
    warp = head_warp(pairs, scalp_size(haired.scalp))
    narrow = eqx.tree_at(
        lambda t: (t.cylinder.radius, t.cylinder.offset),
        haired,
        replace_fn=lambda x: 0.01 * x,
    )
    before = np.asarray(outlines(narrow))
    middle = np.asarray(haired.cylinder.skeleton)[:, None]
    there = transfer(narrow, other)
    after = np.asarray(outlines(there) - there.cylinder.skeleton[:, None])
    tip = slice(3, None)  # nearer to the root it is moved onto the scalp
    space = warp_points(warp, before.reshape(-1, 3)).reshape(before.shape)
    space = space - warp_points(warp, middle.reshape(-1, 3)).reshape(middle.shape)
    # A contour stays perpendicular to the skeleton: compare what is across it.
    skeleton = np.asarray(there.cylinder.skeleton)
    along = np.gradient(skeleton, axis=1)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    across = space - (space * along[:, None]).sum(-1, keepdims=True) * along[:, None]
    size = np.linalg.norm(after, axis=-1)
    error = np.linalg.norm(after - across, axis=-1)
    assert (error[..., tip] < 0.05 * size[..., tip].mean()).all()


def test_the_warp_takes_each_point_to_its_counterpart(dome):
    pairs = correspondences(dome, wide(dome))
    warp = head_warp(pairs, scalp_size(dome))
    assert np.allclose(warp_points(warp, pairs.before), pairs.after, atol=1e-9)
    assert len(pairs.before) == 3 * 17 * 17


def test_the_derivative_of_the_warp_is_the_limit_of_its_differences(dome):
    warp = head_warp(correspondences(dome, wide(dome)), scalp_size(dome))
    p = np.random.default_rng(1).normal(size=(5, 3)) * 0.1
    step = 1e-6
    for axis in range(3):
        move = step * np.eye(3)[axis]
        slope = (warp_points(warp, p + move) - warp_points(warp, p - move)) / (2 * step)
        assert np.allclose(warp_derivatives(warp, p)[..., axis], slope, atol=1e-5)


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_scalp_is_aligned_however_its_corners_are_named(dome, turns, mirrored):
    # Wider than deep and higher in front, as heads are: no way is as good as another.
    p = np.asarray(dome.control) * [1.2, 1.0, 1.0]
    p[..., 1] += 0.2 * p[..., 2] + 0.1 * p[..., 0]
    renamed = np.rot90(np.swapaxes(p, 0, 1) if mirrored else p, turns)
    aligned = align_scalp(
        Scalp(jnp.asarray(1.3 * renamed + 0.5)), Scalp(jnp.asarray(p))
    )
    assert jnp.allclose(aligned.control, 1.3 * p + 0.5, atol=1e-12)


def test_a_pinched_patch_and_repeated_landmarks_are_no_obstacle(dome, make_tree):
    pinched = Scalp(dome.control.at[0].set(dome.control[0, 6]))
    tree = make_tree(pinched, CIRCLES, PARENT)
    face = np.repeat(np.array([[0.0, -0.05, 0.1]]), 3, axis=0)
    same = transfer(tree, pinched, from_points=face, to_points=face)
    assert jnp.allclose(same.cylinder.skeleton, tree.cylinder.skeleton, atol=1e-9)


def test_lengths_are_kept_when_asked_for(haired):
    weights = catmull_rom_weights(6, jnp.linspace(0.0, 1.0, 401))

    def lengths(tree):
        curves = jnp.einsum("pk,ckx->cpx", weights, tree.cylinder.skeleton)
        return jax.vmap(arc_length)(curves)[:, -1]

    for size in (1.25, 0.8):
        scalp = Scalp(size * haired.scalp.control)
        grown = lengths(transfer(haired, scalp))
        assert jnp.allclose(grown, size * lengths(haired), rtol=1e-3)
        kept = lengths(transfer(haired, scalp, keep_lengths=True))
        # Six knots, spread anew, lose some of a zigzag.
        assert jnp.allclose(kept, lengths(haired), rtol=0.03)


def test_wisps_grow_with_their_cluster_and_keep_their_roots(haired):
    there = transfer(haired, Scalp(1.5 * haired.scalp.control))
    assert haired.wisps is not None
    assert there.wisps is not None
    assert jnp.allclose(there.wisps.offset, 1.5 * haired.wisps.offset, atol=1e-9)
    assert jnp.array_equal(there.wisps.uv, haired.wisps.uv)


def test_hair_is_kept_out_of_the_new_head(haired):
    """The new head is a ball that is larger than its scalp says."""

    def ball(p):
        return np.linalg.norm(p, axis=-1) - 0.105

    low, high = np.full(3, -0.15), np.full(3, 0.15)
    field = sample_field(ball, low, high, 0.005)
    sunk = eqx.tree_at(
        lambda t: t.cylinder.skeleton,
        haired,
        replace_fn=lambda p: p.at[:, 2:].multiply(0.5),
    )
    there = transfer(sunk, sunk.scalp, field=field, gap=0.003)
    p = there.cylinder.skeleton[:, 1:].reshape(-1, 3)
    distance = jax.vmap(lambda p: field_distance(field, p).distance)(p)
    assert float(distance.min()) > 0.003 - 5e-4


def test_single_precision_is_kept(haired):
    single = jax.tree.map(
        lambda x: x.astype(jnp.float32) if x.dtype == jnp.float64 else x, haired
    )
    there = transfer(single, Scalp(1.1 * single.scalp.control))
    for leaf in jax.tree.leaves((there.cylinder, there.contour, there.scalp)):
        assert leaf.dtype == jnp.float32
    assert jnp.allclose(
        there.cylinder.skeleton, 1.1 * single.cylinder.skeleton, atol=1e-5
    )


def test_landmarks_on_one_head_alone_are_refused(haired):
    with pytest.raises(ValueError, match="give those on both"):
        transfer(haired, haired.scalp, from_points=np.zeros((4, 3)))


def test_landmarks_that_are_not_equally_many_are_refused(haired):
    with pytest.raises(ValueError, match="4 points on one head and 3 on the other"):
        transfer(
            haired,
            haired.scalp,
            from_points=np.zeros((4, 3)),
            to_points=np.zeros((3, 3)),
        )
