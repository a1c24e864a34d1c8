import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads
from scipy.special import i0
from scipy.stats import logistic

from hairfit.render.chiang import (
    HairFibre,
    chiang,
    chiang_near,
    hair_fibre,
    inside,
    longitudinal,
    trimmed_logistic,
)
from hairfit.render.phase import PhaseAngles

ACROSS = 240


def clear(roughness=0.3, azimuthal=0.3, tilt=0.03, ior=1.55):
    """A fibre that absorbs nothing."""
    numbers = (jnp.asarray(x) for x in (roughness, azimuthal, tilt, ior))
    return HairFibre(jnp.zeros(3), *numbers)


def sphere(count=ACROSS):
    """Directions to the light by Gauss and Legendre, with their solid angles."""
    sine, weight = np.polynomial.legendre.leggauss(count)
    phi = (np.arange(2 * count) + 0.5) * np.pi / count - np.pi
    theta, phi = np.meshgrid(np.arcsin(sine), phi, indexing="ij")
    solid = np.repeat(weight[:, None], 2 * count, axis=1) * np.pi / count
    return theta.ravel(), phi.ravel(), solid.ravel()


def albedo(function, theta_eye):
    """All light of a white sky that comes to the eye."""
    theta, phi, solid = sphere()
    at = PhaseAngles(
        jnp.asarray(theta), jnp.full(len(theta), theta_eye), jnp.asarray(phi)
    )
    found = jax.jit(jax.vmap(function))(at)
    return (np.asarray(found) * (np.cos(theta) * solid)[:, None]).sum(axis=0)


@pytest.mark.parametrize("theta_eye", [0.0, 0.7, -1.3])
@pytest.mark.parametrize("roughness", [(0.2, 0.2), (0.3, 0.6), (1.0, 1.0)])
def test_a_clear_fibre_in_a_white_sky_is_white(theta_eye, roughness):
    fibre = clear(*roughness)
    assert np.allclose(albedo(lambda a: chiang(a, fibre), theta_eye), 1.0, atol=0.01)


@pytest.mark.parametrize("offset", [-0.95, 0.0, 0.5])
def test_so_it_is_at_every_place_across(offset):
    fibre = clear(0.4, 0.4)
    found = albedo(lambda a: chiang_near(a, fibre, jnp.asarray(offset)), 0.4)
    assert np.allclose(found, 1.0, atol=0.01)


def test_pigment_takes_light_away_and_more_of_the_blue():
    blond, black = (
        albedo(lambda a, e=e: chiang(a, hair_fibre(e, 0.0)), 0.2) for e in (0.3, 8.0)
    )
    assert (np.diff(blond) < 0).all() and (black < blond).all()
    assert 0.03 < black.min() < 0.1  # what the cuticle mirrors is left


def slow(theta, theta_eye, phi, h, eta, absorption, beta_m, beta_n, alpha):
    """The same from the papers, with plain functions and no care for overflow."""
    v = (0.726 * beta_m + 0.812 * beta_m**2 + 3.7 * beta_m**20) ** 2
    widths = [v, 0.25 * v, 4 * v, 4 * v]
    s = np.sqrt(np.pi / 8) * (0.265 * beta_n + 1.194 * beta_n**2 + 5.372 * beta_n**22)
    bent = np.sqrt(eta**2 - np.sin(theta_eye) ** 2) / np.cos(theta_eye)
    gamma_o, gamma_t = np.arcsin(h), np.arcsin(h / bent)
    theta_t = np.arcsin(np.sin(theta_eye) / eta)
    a = np.arccos(np.cos(theta_eye) * np.cos(gamma_o))
    b = np.arcsin(np.sin(a) / eta)
    f = 0.5 * (np.sin(a - b) / np.sin(a + b)) ** 2
    f += 0.5 * (np.tan(a - b) / np.tan(a + b)) ** 2
    through = np.exp(-absorption * 2 * np.cos(gamma_t) / np.cos(theta_t))
    shares = [f, (1 - f) ** 2 * through, (1 - f) ** 2 * through**2 * f]
    shares.append(shares[2] * f * through / (1 - f * through))
    total = 0.0
    for p, turn in enumerate([-2 * alpha, alpha, 4 * alpha, 0.0]):
        m = i0(abs(np.cos(theta) * np.cos(theta_eye + turn)) / widths[p])
        m *= np.exp(-np.sin(theta) * np.sin(theta_eye + turn) / widths[p])
        m /= 2 * widths[p] * np.sinh(1 / widths[p])
        straight = 2 * p * gamma_t - 2 * gamma_o + p * np.pi
        x = (phi - straight + np.pi) % (2 * np.pi) - np.pi
        mass = logistic.cdf(np.pi, scale=s) - logistic.cdf(-np.pi, scale=s)
        n = logistic.pdf(x, scale=s) / mass if p < 3 else 1 / (2 * np.pi)
        total += m * shares[p] * n
    return total / np.cos(theta)


def test_it_is_what_the_papers_say():
    rng = np.random.default_rng(0)
    for _ in range(60):
        theta, theta_eye = rng.uniform(-1.4, 1.4, 2)
        phi, h = rng.uniform(-np.pi, np.pi), rng.uniform(-0.99, 0.99)
        eta, colour = rng.uniform(1.3, 1.8), rng.uniform(0.0, 2.0)
        beta_m, beta_n = rng.uniform(0.15, 1.0, 2)
        alpha = rng.uniform(0.0, 0.1)
        numbers = (jnp.asarray(x) for x in (beta_m, beta_n, alpha, eta))
        fibre = HairFibre(jnp.full(3, colour), *numbers)
        at = PhaseAngles(*(jnp.asarray(x) for x in (theta, theta_eye, phi)))
        found = near(at, fibre, jnp.asarray(h))
        expected = slow(theta, theta_eye, phi, h, eta, colour, beta_m, beta_n, alpha)
        assert np.allclose(found, expected, rtol=1e-8, atol=1e-12)


near = jax.jit(chiang_near)
far = jax.jit(chiang)


def test_the_far_field_is_the_mean_across_the_fibre():
    at = PhaseAngles(jnp.asarray(0.3), jnp.asarray(-0.5), jnp.asarray(2.0))
    fibre = hair_fibre()
    h = (np.arange(4000) + 0.5) / 2000 - 1
    each = jax.jit(jax.vmap(chiang_near, (None, None, 0)))(at, fibre, jnp.asarray(h))
    assert np.allclose(far(at, fibre), each.mean(axis=0), rtol=0.01)


def test_the_far_field_is_even_in_azimuth():
    fibre = hair_fibre()
    left, right = (
        PhaseAngles(jnp.asarray(0.3), jnp.asarray(-0.5), jnp.asarray(x))
        for x in (1.1, -1.1)
    )
    assert np.allclose(far(left, fibre), far(right, fibre))


def test_without_tilt_light_and_eye_may_change_places_in_the_plane_across():
    """Where the inclinations are equal and opposite, so are all paths' angles."""
    fibre = clear(tilt=0.0)
    one, other = (
        PhaseAngles(jnp.asarray(x), jnp.asarray(-x), jnp.asarray(0.9))
        for x in (0.4, -0.4)
    )
    assert np.allclose(far(one, fibre), far(other, fibre))


def test_no_lobe_overflows_however_narrow():
    fibre = jax.tree.map(lambda x: x.astype(jnp.float32), clear(0.01, 0.01))
    for theta in np.linspace(-1.5, 1.5, 7):
        at = PhaseAngles(*(jnp.float32(x) for x in (theta, -theta, 0.1)))
        found = near(at, fibre, jnp.float32(0.0))
        assert found.dtype == jnp.float32 and bool(jnp.isfinite(found).all())


@pytest.mark.parametrize("variance", [0.002, 0.05, 0.6])
def test_the_longitudinal_lobe_has_mass_one(variance):
    sine, weight = np.polynomial.legendre.leggauss(2000)
    lobe = jax.vmap(longitudinal, (0, None, None))
    found = lobe(jnp.arcsin(jnp.asarray(sine)), jnp.asarray(0.7), jnp.asarray(variance))
    assert np.isclose(np.asarray(found) @ weight, 1.0)


@pytest.mark.parametrize("scale", [0.02, 0.3, 4.0])
def test_the_trimmed_logistic_has_mass_one(scale):
    x, weight = np.polynomial.legendre.leggauss(3000)
    found = jax.vmap(trimmed_logistic, (0, None))(
        jnp.asarray(np.pi * x), jnp.asarray(scale)
    )
    assert np.isclose(np.pi * np.asarray(found) @ weight, 1.0)


def test_what_goes_out_on_all_paths_is_what_came_in_but_for_the_pigment():
    at = jnp.asarray(0.6), jnp.asarray(0.3)
    shares = inside(at[0], clear(), at[1]).shares
    assert np.allclose(shares.sum(axis=0), 1.0)
    dark = inside(at[0], hair_fibre(8.0), at[1]).shares
    assert (dark.sum(axis=0) < 0.2).all()


def test_gradients_are_right_in_angles_fibre_and_place():
    at = PhaseAngles(jnp.asarray(0.3), jnp.asarray(-0.5), jnp.asarray(2.0))
    check_grads(near, (at, hair_fibre(), jnp.asarray(0.3)), order=1, modes=["rev"])
    check_grads(far, (at, hair_fibre()), order=1, modes=["rev"])


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"eumelanin": -1.0}, "concentrations of at least 0"),
        ({"ior": 1.0}, "an index above 1"),
        ({"roughness": 0.0}, "roughness must be above 0"),
        ({"azimuthal": 1.5}, "at most 1"),
    ],
)
def test_a_fibre_that_cannot_be_is_refused(changed, message):
    with pytest.raises(ValueError, match=message):
        hair_fibre(**changed)
