r"""Opacity volumes against sums over all samples, and closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit.render.lights import DistantLight
from hairfit.render.opacity_volume import OpacityConfig, opacity_volume
from hairfit.render.strand_samples import DepthRange
from hairfit.render.view import View

SIZE, SLABS = 12, 6
NEAR, FAR = 0.1, 0.4
CONFIG = OpacityConfig(slabs=SLABS, samples=3)


def straight_view() -> View:
    """Return parallel rays along z, 100 pixels a metre."""
    matrix = np.diag([100.0, 100.0, 1.0, 1.0])
    return View(jnp.asarray(matrix), jnp.asarray(100.0), SIZE, SIZE)


BETWEEN = DepthRange(jnp.asarray(NEAR), jnp.asarray(FAR))


def make_strands(strands=8, knots=4, seed=0):
    """Return strands that fill the view, some of them over its border."""
    rng = np.random.default_rng(seed)
    root = rng.uniform([0.0, 0.0, 0.15], [0.12, 0.12, 0.3], (strands, 3))
    way = rng.normal(0.0, 0.01, (strands, knots, 3))
    return root[:, None] + np.cumsum(way, axis=1)


def tent(x):
    return np.maximum(1.0 - np.abs(x), 0.0)


def exact(points, width, query):
    """Return opacities as sums over all samples: tents in the picture, slabs in depth.

    Between slices and between pixels' centres they are linear.
    """
    share = (np.arange(3) + 0.5)[:, None] / 3
    slab = (FAR - NEAR) / SLABS
    found = np.zeros(len(query))
    for strand in points:
        for a, b in zip(strand[:-1], strand[1:], strict=True):
            area = width * 100.0 * np.linalg.norm((b - a)[:2]) * 100.0 / 3
            for s in (1.0 - share) * a + share * b:
                found += area * np.array([one(s, q, slab) for q in query])
    return found


def one(sample, query, slab):
    """Return what a sample of area 1 is to a place."""
    centres = np.arange(SIZE) + 0.5
    x, y = (
        np.sum(tent(100 * sample[i] - centres) * tent(100 * query[i] - centres))
        for i in (0, 1)
    )
    slices = NEAR + slab * np.arange(SLABS + 1)
    # A sample is matter that reaches half a slab before and behind it.
    before = np.clip((slices - sample[2]) / slab + 0.5, 0.0, 1.0)
    return x * y * np.interp(query[2], slices, before)


def test_opacity_is_the_sum_of_all_that_is_nearer():
    points = make_strands()
    volume = opacity_volume(
        jnp.asarray(points),
        jnp.asarray(2e-3),
        straight_view(),
        between=BETWEEN,
        config=CONFIG,
    )
    query = np.random.default_rng(1).uniform(
        [-0.01, -0.01, 0.05], [0.13, 0.13, 0.5], (80, 3)
    )
    expected = exact(points, 2e-3, query)
    assert expected.max() > 0.05
    np.testing.assert_allclose(volume.at(jnp.asarray(query)), expected, atol=1e-12)


def fill(strands, seed=0):
    """Return level strands across the view, anywhere between two depths."""
    rng = np.random.default_rng(seed)
    y, z = rng.uniform([0.0, 0.15], [0.12, 0.35], (strands, 2)).T
    x = np.broadcast_to([-0.02, 0.06, 0.14], (strands, 3))
    return np.stack([x, *(np.broadcast_to(u[:, None], x.shape) for u in (y, z))], -1)


def test_a_slab_of_fibres_dims_light_as_beer_and_lambert_say():
    strands, width = 20_000, 1e-5
    points = jnp.asarray(fill(strands), jnp.float64)
    volume = opacity_volume(
        points,
        jnp.asarray(width),
        straight_view(),
        between=BETWEEN,
        config=OpacityConfig(slabs=30, samples=10),
    )
    sigma = strands * width / (0.12 * 0.2)  # area of fibres in a volume, 1 / m
    depth = np.linspace(0.12, 0.38, 14)
    query = np.stack([np.full(14, 0.06), np.full(14, 0.06), depth], -1)
    found = volume.transmittance(jnp.asarray(query), 1.5)
    way = np.clip(depth - 0.15, 0.0, 0.2)
    np.testing.assert_allclose(found, np.exp(-1.5 * sigma * way), atol=0.03)


def test_nearer_than_all_hair_and_beside_it_all_light_arrives():
    points = jnp.asarray(make_strands())
    volume = opacity_volume(points, jnp.asarray(1.0), straight_view(), config=CONFIG)
    query = jnp.array([[0.06, 0.06, -1.0], [5.0, 0.06, 0.39]])
    np.testing.assert_array_equal(volume.transmittance(query), 1.0)


def test_beyond_all_hair_opacity_is_the_whole_area():
    points = jnp.asarray(0.06 + 0.5 * (make_strands() - 0.06))
    volume = opacity_volume(points, jnp.asarray(2e-3), straight_view(), config=CONFIG)
    x, y = np.meshgrid(*2 * [(np.arange(SIZE) + 0.5) / 100.0])
    query = np.stack([x, y, np.full_like(x, 9.0)], -1).reshape(-1, 3)
    length = np.linalg.norm(np.diff(points[..., :2], axis=1), axis=-1).sum()
    total = float(volume.at(jnp.asarray(query)).sum())
    assert total == pytest.approx(length * 2e-3 * 100.0**2, rel=1e-9)


@pytest.mark.parametrize("form", ["scatter", "gather"])
def test_gradients_are_those_of_finite_differences(form):
    points = make_strands(4)
    query = np.random.default_rng(1).uniform(
        [0.0, 0.0, 0.1], [0.12, 0.12, 0.4], (20, 3)
    )
    config = OpacityConfig(slabs=SLABS, samples=2, form=form)

    def lit(points, width, query, matrix):
        points, width, query, matrix = map(jnp.asarray, (points, width, query, matrix))
        view = View(matrix, jnp.asarray(100.0), SIZE, SIZE)
        volume = opacity_volume(points, width, view, between=BETWEEN, config=config)
        return volume.transmittance(query)

    arguments = points, np.full((4, 1), 2e-2), query, np.array(straight_view().matrix)
    check_grads(jax.jit(lit), arguments, order=1, modes=["rev"], eps=1e-7, rtol=1e-3)


def test_a_light_sees_as_much_hair_from_all_sides_of_a_level_strand():
    strand = jnp.stack([jnp.linspace(-0.05, 0.05, 6), *jnp.zeros((2, 6))], -1)[None]
    for angle in (0.0, 1.0, 2.5):
        light = DistantLight(
            jnp.array([0.0, np.cos(angle), np.sin(angle)]), jnp.ones(3)
        )
        view, between = light.view(strand, 32)
        volume = opacity_volume(
            strand, jnp.asarray(1e-3), view, between=between, config=CONFIG
        )
        whole = volume.opacity.reshape(-1, SLABS + 1)[:, -1].sum()
        assert float(whole) == pytest.approx(
            0.1 * 1e-3 * float(view.pixels_per_metre) ** 2, rel=1e-9
        )


def test_one_slab_is_refused():
    with pytest.raises(ValueError, match="at least 2 slabs, got 1"):
        OpacityConfig(slabs=1)
