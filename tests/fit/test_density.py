import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import RADIUS, dome

from hairfit.fit.density import TEXELS, density_maps, root_spacing, spread, texel_areas
from hairfit.model import Scalp


@pytest.fixture
def flat():
    """A flat scalp of 20 by 10 cm."""
    x, z = np.meshgrid(np.linspace(0, 0.2, 13), np.linspace(0, 0.1, 13), indexing="ij")
    return Scalp(jnp.asarray(np.stack([x, np.zeros_like(x), z], axis=-1)))


def test_the_spacing_of_a_grid_of_roots_is_its_own():
    u, v = np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21))
    assert root_spacing(np.stack([u, v], axis=-1).reshape(-1, 2)) == pytest.approx(0.05)


def test_one_root_has_a_spacing():
    assert root_spacing(np.array([[0.5, 0.5]])) > 0.0


def test_every_root_is_counted_once():
    uv = np.random.default_rng(0).uniform(size=(500, 2))
    assert spread(uv).sum() == pytest.approx(500.0)
    at = np.array([[0.25, 1.0]]) * [(TEXELS - 2) / (TEXELS - 1), 1.0]
    assert (spread(at) > 0.0).sum() <= 2


def test_the_texels_of_a_flat_scalp_share_its_area(flat):
    area = texel_areas(flat)
    assert area.sum() == pytest.approx(0.2 * 0.1)
    inner = area[1:-1, 1:-1]
    assert np.allclose(inner, inner[0, 0]) and np.allclose(area[0, 0], inner[0, 0] / 4)


def test_the_texels_of_a_dome_share_that_of_the_sphere():
    # The square of tangents cuts out of the sphere what a pyramid of its angles does.
    solid = 4.0 * np.arctan(1.0 / (0.6 * np.sqrt(2.0 + 0.36)))
    assert texel_areas(dome()).sum() == pytest.approx(solid * RADIUS**2, rel=0.01)


def test_density_is_that_of_the_roots(flat):
    rng = np.random.default_rng(1)
    uv = rng.uniform(0.05, 0.95, (9000, 2))
    uv = np.concatenate([uv, rng.uniform([0.5, 0.05], [0.95, 0.95], (9000, 2))])
    density = np.asarray(density_maps(flat, uv).density)
    u = np.linspace(0.0, 1.0, TEXELS)
    few, many = density[(u > 0.1) & (u < 0.45)], density[(u > 0.55) & (u < 0.9)]
    inner = slice(10, -10)
    # Four half as many on twice as wide: 10 000 a unit here, 30 000 there.
    assert many[:, inner].mean() / few[:, inner].mean() == pytest.approx(3.0, rel=0.1)
    assert density.max() <= 1.0 and density[0, 0] < 0.2 * few.mean()
