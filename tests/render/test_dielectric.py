import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit.render.dielectric import fresnel, inner_cosine

share = jax.jit(fresnel)


def test_glass_sends_four_percent_back_at_normal_incidence_and_all_at_grazing():
    """Figure 5-10 of the thesis: an index of 1.5."""
    assert np.isclose(share(jnp.asarray(1.0), 1.5), 0.04)
    assert np.isclose(share(jnp.asarray(0.0), 1.5), 1.0)


@pytest.mark.parametrize("ior", [1.2, 1.55, 3.5])
def test_at_brewsters_angle_only_one_polarisation_comes_back(ior):
    angle = np.arctan(ior)
    crossed = np.sin(angle - (np.pi / 2 - angle)) ** 2
    assert np.isclose(share(jnp.asarray(np.cos(angle)), ior), 0.5 * crossed)


def test_beyond_the_critical_angle_all_is_reflected():
    angle = np.arcsin(1 / 1.5) + 0.05
    assert np.isclose(share(jnp.asarray(np.cos(angle)), 1 / 1.5), 1.0)
    assert inner_cosine(jnp.asarray(np.sin(angle) ** 2), 1 / 1.5) == 0.0


def test_two_indices_are_one_for_each_polarisation():
    cosine = jnp.asarray(0.6)
    both = share(cosine, 1.4, 1.7)
    crossed = 2 * share(cosine, 1.4) - flat(0.6, 1.4)
    assert np.isclose(2 * both, crossed + flat(0.6, 1.7))


def flat(cosine, ior):
    angle = np.arccos(cosine)
    inner = np.arcsin(np.sin(angle) / ior)
    return (np.tan(angle - inner) / np.tan(angle + inner)) ** 2


def test_the_gradient_is_right():
    check_grads(share, (jnp.asarray(0.4), 1.5), order=1, modes=["rev"], rtol=1e-6)
