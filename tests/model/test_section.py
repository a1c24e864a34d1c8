import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from hairfit.model import GeneralizedCylinder, cylinder_frames, cylinder_knots
from hairfit.model import section as plain

section_maps, with_section_maps = map(
    jax.jit, (plain.section_maps, plain.with_section_maps)
)
carry, on_skeleton = jax.jit(plain.carry), jax.jit(plain.on_skeleton)
least_rotation, rotation = jax.jit(plain.least_rotation), jax.jit(plain.rotation)
points_at = jax.jit(jax.vmap(cylinder_knots, (None, None, 0)))
KNOTS = 6


def random_cylinder(seed, knots=KNOTS) -> GeneralizedCylinder:
    rng = np.random.default_rng(seed)
    up = 0.04 * np.arange(knots)[:, None] * np.array([[0.0, 1.0, 0.0]])
    arrays = {
        "skeleton": up + 0.01 * rng.normal(size=(knots, 3)),
        "normal": np.array([1.0, 0.0, 0.2]),
        "radius": 0.02 + 0.002 * rng.normal(size=knots),
        "offset": 0.001 * rng.normal(size=(knots, 32)),
        "scale": 1.0 + 0.3 * rng.normal(size=(knots, 2)),
        "twist": 3.0 * rng.normal(size=knots).cumsum(),
        "shear": 0.3 * rng.normal(size=knots),
    }
    return GeneralizedCylinder(**{k: jnp.asarray(v) for k, v in arrays.items()})


@pytest.fixture(scope="module")
def some() -> GeneralizedCylinder:
    return random_cylinder(0)


def test_a_map_is_the_cross_section_of_equation_4_4(some):
    frames = cylinder_frames(some)
    maps = section_maps(some)
    theta = 0.7
    got = points_at(some, 0.8, jnp.array([theta]))[0]
    for k in range(KNOTS):
        radius = 0.8 * plain_radius(some, k, theta)
        x, y = radius * np.asarray(maps[k]) @ np.array([np.cos(theta), np.sin(theta)])
        want = some.skeleton[k] + x * frames.normal[k] + y * frames.binormal[k]
        assert jnp.allclose(got[k], want, atol=1e-12)


def plain_radius(cylinder, knot, theta):
    angles = np.arange(32) * (2 * np.pi / 32)
    offset = np.interp(theta, angles, cylinder.offset[knot], period=2 * np.pi)
    return float(cylinder.radius[knot]) + offset


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_decomposing_its_own_maps_returns_the_cluster(seed):
    """Also with many turns from knot to knot, and scales of either sign."""
    cylinder = random_cylinder(seed)
    again = with_section_maps(cylinder, section_maps(cylinder))
    for name in ("scale", "twist", "shear"):
        assert jnp.allclose(getattr(again, name), getattr(cylinder, name), atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000))
def test_any_maps_are_what_the_cluster_has_afterwards(seed):
    maps = jnp.asarray(np.random.default_rng(seed).normal(size=(KNOTS, 2, 2)))
    cylinder = with_section_maps(random_cylinder(seed + 1), maps)
    assert jnp.allclose(section_maps(cylinder), maps, atol=1e-9)
    straight = eqx.tree_at(
        lambda c: (c.twist, c.scale),
        cylinder,
        (jnp.zeros(KNOTS), jnp.ones((KNOTS, 2))),
    )
    turns = jnp.diff(with_section_maps(straight, maps).twist)
    assert jnp.all(jnp.abs(turns) <= jnp.pi / 2 + 1e-9)


def test_maps_without_a_second_row_keep_the_twist(some):
    maps = section_maps(some).at[2, 1].set(0.0).at[4].set(0.0)
    cylinder = with_section_maps(some, maps)
    assert jnp.allclose(section_maps(cylinder), maps, atol=1e-12)
    assert jnp.allclose(cylinder.twist[jnp.array([2, 4])], some.twist[2:5:2])


def test_decomposition_has_gradients(some):
    def decompose(maps):
        new = plain.with_section_maps(some, maps)
        return new.scale, new.twist, new.shear

    check_grads(jax.jit(decompose), (section_maps(some),), order=1, modes=["rev"])
    slopes = jax.jacrev(decompose)(jnp.zeros((KNOTS, 2, 2)))
    assert all(jnp.all(jnp.isfinite(leaf)) for leaf in jax.tree.leaves(slopes))


def test_a_rigid_motion_carries_the_cross_sections(some):
    turn = rotation(jnp.array([0.6, 0.0, 0.8]), jnp.array(2.2))
    shift = jnp.array([0.1, -0.2, 0.3])
    skeleton = some.skeleton @ turn.T + shift[None]
    there = carry(some, skeleton, jnp.tile(turn[None], (KNOTS, 1, 1)))
    theta = jnp.linspace(0.0, 6.0, 7)
    want = points_at(some, 1.0, theta) @ turn.T + shift[None, None]
    assert jnp.allclose(points_at(there, 1.0, theta), want, atol=1e-12)
    assert jnp.allclose(there.twist, some.twist, atol=1e-9)


def test_a_hint_of_turns_tells_by_how_many_the_content_is_turned(some):
    turns = jnp.linspace(0.0, 40.0, KNOTS)
    frames = cylinder_frames(some)
    moved = jax.vmap(rotation)(frames.tangent, turns)
    bare = eqx.tree_at(
        lambda c: (c.scale, c.shear), some, (some.scale * 0 + 1, turns * 0)
    )
    there = carry(bare, bare.skeleton, moved, turns + 0.2)
    assert jnp.allclose(there.twist, bare.twist + turns, atol=1e-9)


def test_a_cluster_on_another_skeleton_keeps_its_thickness_and_its_far_end(some):
    knot = 2
    skeleton = some.skeleton.at[knot].add(jnp.array([0.02, 0.01, 0.0]))
    there = on_skeleton(some, skeleton)
    theta = jnp.linspace(0.0, 6.0, 7)
    before, after = points_at(some, 1.0, theta), points_at(there, 1.0, theta)
    far = jnp.array([0, 4, 5])  # neither the point nor the tangent has changed
    assert jnp.allclose(before[:, far], after[:, far], atol=1e-12)
    around = [
        jnp.linalg.norm(p - c.skeleton[None], axis=-1)
        for p, c in ((before, some), (after, there))
    ]
    assert jnp.allclose(around[0], around[1], atol=1e-12)


def test_the_least_rotation_takes_one_vector_to_the_other():
    rng = np.random.default_rng(0)
    for _ in range(20):
        a, b = rng.normal(size=(2, 3))
        a, b = jnp.asarray(a / np.linalg.norm(a)), jnp.asarray(b / np.linalg.norm(b))
        turn = least_rotation(a, b)
        assert jnp.allclose(turn @ a, b, atol=1e-12)
        assert jnp.allclose(turn @ turn.T, jnp.eye(3), atol=1e-12)
        axis = jnp.cross(a, b)
        assert jnp.allclose(turn @ axis, axis, atol=1e-12)


def test_the_least_rotation_between_opposite_vectors_is_half_a_turn():
    a = jnp.array([0.6, 0.0, -0.8])
    half = least_rotation(a, -a)
    assert jnp.allclose(half @ a, -a, atol=1e-12)
    assert jnp.allclose(jnp.linalg.det(half), 1.0)
    assert jnp.allclose(least_rotation(a, a), jnp.eye(3), atol=1e-15)
    slopes = jax.jit(jax.jacrev(plain.least_rotation))(a, -a)
    assert jnp.all(jnp.isfinite(slopes))


def test_a_rotation_by_a_quarter_turn_is_known_by_hand():
    got = rotation(jnp.array([0.0, 0.0, 1.0]), jnp.array(np.pi / 2))
    assert jnp.allclose(got, jnp.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]))
