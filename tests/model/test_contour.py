import jax
import jax.numpy as jnp
import numpy as np
from jax.test_util import check_grads

from hairfit.model import contour_radius

OFFSET = jnp.asarray(np.random.default_rng(0).normal(size=32))


def test_the_radius_is_the_global_one_and_an_offset():
    angles = jnp.arange(32.0) * (2 * jnp.pi / 32)
    at = jax.vmap(contour_radius, (None, None, 0))
    assert jnp.allclose(at(2.0, OFFSET, angles), 2.0 + OFFSET, atol=1e-12)
    between = 2.0 + 0.75 * OFFSET[31] + 0.25 * OFFSET[0]
    assert jnp.allclose(at(2.0, OFFSET, angles[31:] + jnp.pi / 64), between, atol=1e-12)


def test_the_contour_closes():
    theta = jnp.linspace(-7.0, 7.0, 31)
    at = jax.vmap(contour_radius, (None, None, 0))
    turned = at(1.0, OFFSET, theta + 2 * jnp.pi)
    assert jnp.allclose(at(1.0, OFFSET, theta), turned, atol=1e-12)


def test_gradients_of_contours():
    check_grads(jax.jit(contour_radius), (1.0, OFFSET, 0.3), order=1)
