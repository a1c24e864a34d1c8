import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render.chiang import HairFibre, hair_fibre
from hairfit.render.marschner import (
    attenuation,
    bend_at,
    cubic_roots,
    marschner,
    only_root,
    passed_through,
    reflected_once,
    turned_once,
)
from hairfit.render.phase import PhaseAngles
from hairfit.render.single_layer import simulate_layer

PHI = (np.arange(7200) + 0.5) * np.pi / 3600 - np.pi


def clear(ior=1.55):
    numbers = (jnp.asarray(x) for x in (0.3, 0.3, 0.03, ior))
    return HairFibre(jnp.zeros(3), *numbers)


def around(lobe, bend):
    return np.asarray(jax.jit(jax.vmap(lobe, (0, None)))(jnp.asarray(PHI), bend))[:, 0]


def mass(values):
    return values.sum() * np.pi / 3600


def shares(path, bend):
    """The light of one path in all, by even offsets across the fibre."""
    entry = np.arcsin((np.arange(4000) + 0.5) / 2000 - 1)
    each = jax.vmap(attenuation, (None, 0, None))(path, jnp.asarray(entry), bend)
    return float(each[:, 0].mean())


@pytest.mark.parametrize("difference", [0.0, 0.8])
@pytest.mark.parametrize("ior", [1.4, 1.55, 1.8])
def test_each_lobe_has_the_light_of_its_path(difference, ior):
    bend = bend_at(jnp.asarray(difference), clear(ior))
    assert np.isclose(mass(around(reflected_once, bend)), shares(0, bend), rtol=1e-3)
    # The cubic of the paper stands for the sines.
    assert np.isclose(mass(around(passed_through, bend)), shares(1, bend), rtol=0.05)


def test_light_that_passes_through_is_where_rays_go():
    """Against the ray by ray simulation of the thesis, where TT goes."""
    bend = bend_at(jnp.asarray(0.0), clear(1.5))
    table = simulate_layer(1.5, rays=4_000_000, bins=90)
    middle = 0.5 * (table.edges[1:] + table.edges[:-1])
    ahead = np.abs(middle) > 2.3
    lobes = [reflected_once, passed_through]
    found = sum(
        np.asarray(jax.vmap(lobe, (0, None))(jnp.asarray(middle[ahead]), bend))[:, 0]
        for lobe in lobes
    )
    # The paper's cubic for the sines puts up to a tenth of the peak elsewhere.
    assert np.abs(found - table.density[ahead]).max() < 0.1 * table.density.max()


def test_the_caustic_is_where_the_rainbow_is_and_finite():
    bend = bend_at(jnp.asarray(0.0), clear(1.33))
    lobe = around(turned_once, bend)
    assert np.isfinite(lobe).all() and (lobe >= 0.0).all()
    entry = np.arcsin(np.sqrt((4 - 1.33**2) / 3))
    rainbow = abs(4 * np.arcsin(np.sin(entry) / 1.33) - 2 * entry)
    assert np.isclose(np.degrees(rainbow), 42.5, atol=0.3)  # that of water
    assert abs(abs(PHI[np.argmax(lobe)]) - rainbow) < 0.1
    assert np.allclose(lobe, lobe[::-1], rtol=1e-6)


def test_above_an_index_of_two_there_is_no_caustic():
    """At grazing light: all of TRT is one smooth lobe with the light of its path."""
    bend = bend_at(jnp.asarray(1.35), clear(1.55))
    assert bend.index > 2.5
    lobe = around(turned_once, bend)
    assert np.isclose(mass(lobe), shares(2, bend), rtol=0.15)


@pytest.mark.parametrize("p", [-2.0, -0.3])
@pytest.mark.parametrize("q", [-1.0, -0.01, 0.4])
def test_the_roots_are_all_roots_of_the_cubic(p, q):
    found = [
        float(x) for x, there in cubic_roots(jnp.asarray(p), jnp.asarray(q)) if there
    ]
    expected = np.roots([1.0, 0.0, p, q])
    expected = np.sort(expected[np.abs(expected.imag) < 1e-9].real)
    assert np.allclose(np.sort(found), expected)


@pytest.mark.parametrize("q", [-1.0, 0.0, 0.4])
def test_a_cubic_that_rises_has_one_root(q):
    found = [
        float(x) for x, there in cubic_roots(jnp.asarray(0.7), jnp.asarray(q)) if there
    ]
    assert len(found) == 1 and np.isclose(found[0] ** 3 + 0.7 * found[0] + q, 0.0)
    assert np.isclose(found[0], only_root(jnp.asarray(0.7), jnp.asarray(q)))


def test_the_primary_highlight_is_turned_by_twice_the_tilt_to_the_root():
    fibre = hair_fibre(8.0, 0.0, roughness=0.1, tilt_deg=3.0)
    theta = np.linspace(-0.6, 0.6, 601)
    at = PhaseAngles(jnp.asarray(theta), jnp.zeros(601), jnp.zeros(601))
    found = np.asarray(jax.jit(jax.vmap(marschner, (0, None)))(at, fibre))[:, 2]
    assert abs(theta[np.argmax(found)] - 2.0 * np.radians(3.0)) < 0.03


@pytest.mark.parametrize("theta_eye", [0.0, 0.5])
def test_a_clear_fibre_in_a_white_sky_lacks_the_light_of_longer_paths_alone(theta_eye):
    fibre = HairFibre(jnp.zeros(3), *(jnp.asarray(x) for x in (0.1, 0.3, 0.0, 1.55)))
    sine, weight = np.polynomial.legendre.leggauss(200)
    theta, phi = np.meshgrid(np.arcsin(sine), PHI[::20], indexing="ij")
    solid = np.repeat(weight[:, None], phi.shape[1], axis=1) * 2 * np.pi / phi.shape[1]
    level = jnp.full(theta.size, theta_eye)
    at = PhaseAngles(jnp.asarray(theta.ravel()), level, jnp.asarray(phi.ravel()))
    found = np.asarray(jax.jit(jax.vmap(marschner, (0, None)))(at, fibre))[:, 0]
    total = (found * np.cos(theta.ravel()) * solid.ravel()).sum()
    bend = bend_at(jnp.asarray(theta_eye), fibre)
    expected = sum(shares(path, bend) for path in range(3))
    assert 0.97 < expected < 1.0 and np.isclose(total, expected, rtol=0.06)


def test_gradients_are_finite():
    def total(at, fibre):
        return marschner(at, fibre).sum()

    slopes = jax.jit(jax.vmap(jax.grad(total, (0, 1)), (0, None)))
    rng = np.random.default_rng(0)
    spread = jnp.asarray(rng.uniform(-1.4, 1.4, (3, 300)))
    at = PhaseAngles(spread[0], spread[1], 2.2 * jnp.abs(spread[2]))
    for leaf in jax.tree.leaves(slopes(at, hair_fibre())):
        assert bool(jnp.isfinite(leaf).all())
