import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from hairfit.render.phase import (
    Directionality,
    Lobes,
    PhaseAngles,
    empirical_phase,
    goldman_phase,
    kajiya_kay_phase,
    phase_angles,
    reflected,
    transmitted,
)
from hairfit.render.shading import Fibre, kajiya_kay

FIBRE = Fibre(
    jnp.array([0.1, 0.05, 0.02]),
    jnp.array([0.5, 0.3, 0.2]),
    jnp.array([0.6, 0.6, 0.7]),
    jnp.array(20.0),
)
angles_of = jax.jit(phase_angles)
seeds = st.integers(0, 10_000)


def three_directions(seed):
    vectors = np.random.default_rng(seed).normal(size=(3, 3))
    return jnp.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def frame_angles(theta, theta_eye, phi):
    return PhaseAngles(jnp.asarray(theta), jnp.asarray(theta_eye), jnp.asarray(phi))


@settings(max_examples=50, deadline=None)
@given(seeds)
def test_the_angles_put_light_and_eye_back_where_they_were(seed):
    """In the frame of figure 5-4: T, N towards the light, and across both."""
    tangent, light, eye = three_directions(seed)
    found = angles_of(tangent, light, eye)
    normal = light - (light @ tangent) * tangent
    normal = normal / jnp.linalg.norm(normal)
    side = jnp.cross(tangent, normal)
    side = side * jnp.where(eye @ side < 0.0, -1.0, 1.0)
    cos, sin = jnp.cos, jnp.sin
    again = sin(found.theta) * tangent + cos(found.theta) * normal
    assert jnp.allclose(again, light, atol=1e-9)
    across = cos(found.phi) * normal + sin(found.phi) * side
    again = sin(found.theta_eye) * tangent + cos(found.theta_eye) * across
    assert jnp.allclose(again, eye, atol=1e-7)
    assert 0.0 <= found.phi <= jnp.pi


def test_light_along_the_fibre_has_no_azimuth_and_finite_gradients():
    tangent = jnp.array([0.0, 1.0, 0.0])
    eye = jnp.array([0.6, 0.0, 0.8])
    found = angles_of(tangent, tangent, eye)
    assert found.theta == jnp.pi / 2 and found.phi == 0.0
    for argument in range(3):
        slopes = jax.jacrev(phase_angles, argument)(tangent, tangent, eye)
        assert all(bool(jnp.isfinite(leaf).all()) for leaf in slopes)


@settings(max_examples=50, deadline=None)
@given(seeds)
def test_kajiya_kay_is_the_same_in_angles_and_in_vectors(seed):
    tangent, light, eye = three_directions(seed)
    by_angles = kajiya_kay_phase(angles_of(tangent, light, eye), FIBRE)
    assert jnp.allclose(by_angles, kajiya_kay(tangent, light, eye, FIBRE), atol=1e-8)


@settings(max_examples=50, deadline=None)
@given(seeds)
def test_goldmans_kappa_is_that_of_the_cross_products(seed):
    """Equation (5-12) by itself, without the frame of (5-15)."""
    tangent, light, eye = three_directions(seed)
    a, b = jnp.cross(tangent, light), jnp.cross(tangent, eye)
    kappa = (a @ b) / (jnp.linalg.norm(a) * jnp.linalg.norm(b))
    side = Directionality(jnp.array([1.0, 0.5, 0.2]), jnp.array([0.1, 0.4, 0.9]))
    share = (1 + kappa) / 2 * side.reflect + (1 - kappa) / 2 * side.transmit
    lit = kajiya_kay(tangent, light, eye, FIBRE) - FIBRE.ambient
    found = goldman_phase(angles_of(tangent, light, eye), FIBRE, side)
    assert jnp.allclose(found, FIBRE.ambient + share * lit, atol=1e-7)


def test_goldman_with_equal_shares_is_kajiya_kay():
    at = frame_angles(0.3, -0.2, 2.0)
    even = Directionality(jnp.ones(3), jnp.ones(3))
    assert jnp.allclose(goldman_phase(at, FIBRE, even), kajiya_kay_phase(at, FIBRE))


def test_the_backward_lobe_is_what_mirrors_on_a_circle_send_back():
    """Light of cos(phi) at phi goes to 2 phi: (5-20) and figure 5-6c."""
    place = np.linspace(-np.pi / 2, np.pi / 2, 101)
    sent = jax.vmap(reflected)(2.0 * place)
    assert np.allclose(sent, np.cos(place), atol=1e-12)
    assert reflected(0.0) == 1.0
    assert np.allclose(reflected(jnp.asarray(2.5 * np.pi)), np.cos(np.pi / 4))


@pytest.mark.parametrize("k", [1.0, 2.0, 4.0])
def test_the_forward_lobe_is_as_wide_as_figure_5_8_has_it(k):
    phi = np.linspace(-np.pi, np.pi, 721)
    lobe = np.asarray(jax.vmap(transmitted, (0, None))(phi, k))
    assert np.isclose(lobe[0], 1.0) and np.isclose(lobe[-1], 1.0)
    assert np.array_equal(lobe > 1e-9, np.abs(phi) > np.pi * (1 - 1 / (2 * k)) + 1e-9)
    half = np.pi - np.arccos(0.5) / k
    assert np.isclose(transmitted(half, k), 0.5)


def test_the_empirical_model_is_the_product_of_5_24():
    lobes = Lobes(jnp.full(3, 0.3), jnp.full(3, 1.0), jnp.array(5.0))
    theta, theta_eye, phi = 0.4, -0.3, 3.0
    found = empirical_phase(frame_angles(theta, theta_eye, phi), FIBRE, lobes)
    lengthwise = 0.5 * np.cos(theta) + 0.6 * np.cos(theta + theta_eye) ** 20
    around = 0.3 * np.cos(phi / 2) + np.cos(5.0 * (phi - np.pi))
    assert np.isclose(found[0], 0.1 + lengthwise * around)


def test_the_models_have_right_gradients():
    lobes = Lobes(jnp.full(3, 0.3), jnp.full(3, 1.0), jnp.array(3.0))
    side = Directionality(jnp.full(3, 0.8), jnp.full(3, 0.4))

    def total(tangent, light, eye, fibre, lobes, side):
        at = phase_angles(tangent, light, eye)
        return (
            kajiya_kay_phase(at, fibre)
            + goldman_phase(at, fibre, side)
            + empirical_phase(at, fibre, lobes)
        )

    arguments = (*three_directions(3), FIBRE, lobes, side)
    check_grads(jax.jit(total), arguments, order=1, modes=["rev"], eps=1e-6, rtol=1e-4)


def test_single_precision_is_kept():
    one = jnp.float32(0.3)
    at = PhaseAngles(one, one, one)
    fibre = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), FIBRE)
    lobes = Lobes(jnp.ones(3, jnp.float32), jnp.ones(3, jnp.float32), jnp.float32(2.0))
    assert empirical_phase(at, fibre, lobes).dtype == jnp.float32
