import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit import model
from hairfit.model import Frames
from hairfit.model.vector import norm, unit

# Compiled once for all tests.
frenet_frames = jax.jit(model.frenet_frames)
rotation_minimising_frames = jax.jit(model.rotation_minimising_frames)
slopes_of = {
    frenet_frames: jax.jit(jax.jacrev(frenet_frames)),
    rotation_minimising_frames: jax.jit(
        jax.jacrev(rotation_minimising_frames, argnums=(0, 1))
    ),
}
UP = jnp.array([0.0, 0.0, 1.0])


def helix(knots: int, radius=1.0, pitch=0.5, turns=1.0):
    angle = jnp.linspace(0.0, 2 * jnp.pi * turns, knots)
    circle = radius * jnp.stack([jnp.cos(angle), jnp.sin(angle)], 1)
    return jnp.concatenate([circle, (pitch * angle)[:, None]], 1)


def assert_orthonormal(frames: Frames):
    basis = jnp.stack(frames, axis=1)
    eye = jnp.broadcast_to(jnp.eye(3), basis.shape)
    assert jnp.allclose(basis @ basis.transpose(0, 2, 1), eye, atol=1e-12)
    assert jnp.allclose(jnp.linalg.det(basis), 1.0, atol=1e-12)


def test_frames_of_a_circle_do_not_twist():
    circle = helix(24, pitch=0.0, turns=0.8)
    frames = rotation_minimising_frames(circle, UP)
    assert_orthonormal(frames)
    assert jnp.allclose(frames.normal, jnp.broadcast_to(UP, (24, 3)), atol=1e-12)
    # In the plane, the normal keeps pointing away from the centre.
    inside = circle[1:-1] / norm(circle[1:-1])[:, None]
    frames = rotation_minimising_frames(circle, circle[0])
    start = jnp.sum(frames.normal[1] * inside[0])
    assert jnp.allclose(jnp.sum(frames.normal[1:-1] * inside, 1), start, atol=1e-12)


def test_frames_of_a_helix_turn_back_by_its_torsion():
    # Against the Frenet frame, a rotation-minimising frame turns by -torsion a length.
    radius, pitch, knots = 1.0, 0.5, 401
    skeleton = helix(knots, radius, pitch)
    length = 2 * np.pi * np.hypot(radius, pitch)
    torsion = pitch / (radius**2 + pitch**2)
    frenet = frenet_frames(skeleton)
    frames = rotation_minimising_frames(skeleton, frenet.normal[1])
    n = frames.normal[jnp.array([1, -2])]
    cos = jnp.sum(n * frenet.normal[jnp.array([1, -2])], 1)
    sin = jnp.sum(n * frenet.binormal[jnp.array([1, -2])], 1)
    turn = jnp.arctan2(sin, cos)
    want = -torsion * length * (knots - 3) / (knots - 1)
    error = jnp.mod(turn[1] - turn[0] - want + jnp.pi, 2 * jnp.pi) - jnp.pi
    assert abs(error) < 1e-3


def test_frenet_normals_of_a_helix_point_to_its_axis():
    skeleton = helix(200)
    frames = frenet_frames(skeleton)
    assert_orthonormal(frames)
    inward = -skeleton[:, :2] / norm(skeleton[:, :2])[:, None]
    assert jnp.allclose(frames.normal[2:-2, :2], inward[2:-2], atol=1e-3)


def test_frames_of_a_straight_skeleton_are_constant():
    line = jnp.linspace(0.0, 1.0, 6)[:, None] * jnp.array([[1.0, 2.0, 3.0]])
    frames = rotation_minimising_frames(line, jnp.array([3.0, 0.0, 1.0]))
    assert_orthonormal(frames)
    assert jnp.allclose(frames.normal, frames.normal[:1], atol=1e-12)
    assert_orthonormal(frenet_frames(line))


@pytest.mark.parametrize(
    "skeleton",
    [
        np.linspace(0, 1, 5)[:, None] * [[0.0, 1.0, 0.0]],
        np.zeros((5, 3)),
        np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 0, 0], [2, 0, 0]]),
        np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0], [0, 0, 0]]),
    ],
    ids=["straight", "a point", "coincident knots", "there and back"],
)
@pytest.mark.parametrize("normal", [UP, jnp.array([0.0, 1.0, 0.0]), jnp.zeros(3)])
@pytest.mark.parametrize("frames_of", [rotation_minimising_frames, frenet_frames])
def test_degenerate_skeletons_have_frames_and_finite_gradients(
    skeleton, normal, frames_of
):
    skeleton = jnp.asarray(skeleton)
    arguments = (skeleton, normal) if frames_of is not frenet_frames else (skeleton,)
    assert_orthonormal(frames_of(*arguments))
    for slope in jax.tree.leaves(slopes_of[frames_of](*arguments)):
        assert jnp.all(jnp.isfinite(slope))


def test_gradients_of_frames():
    check_grads(rotation_minimising_frames, (helix(6), UP), order=1)
    check_grads(frenet_frames, (helix(6),), order=1)
    line = jnp.linspace(0.0, 1.0, 6)[:, None] * jnp.array([[1.0, 2.0, 3.0]])
    check_grads(rotation_minimising_frames, (line, UP), order=1)


def test_unit_and_norm_are_defined_at_zero():
    zero = jnp.zeros(3)
    assert norm(zero) == 0.0
    assert jnp.array_equal(unit(zero, UP), UP)
    assert jnp.array_equal(jax.grad(norm)(zero), zero)


def test_two_knots_are_too_few_for_frenet():
    with pytest.raises(ValueError, match="at least 3 knots, got 2"):
        frenet_frames(jnp.eye(3)[:2])
