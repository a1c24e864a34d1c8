import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from hairfit.model.maps import (
    even_maps,
    fill,
    keep_roots,
    mirror_map,
    paint,
    resize_map,
    root_attributes,
    sample_map,
    sample_roots_by_density,
    smooth_map,
    stroke_distance,
    symmetric_map,
)
from hairfit.model.scalp import sample_roots

sample = jax.jit(jax.vmap(sample_map, (None, 0)))
distance = jax.jit(jax.vmap(stroke_distance, (None, 0)))


def noise(*shape, seed=0):
    return jnp.asarray(np.random.default_rng(seed).uniform(size=shape))


def test_texels_are_corners_and_values_between_them_bilinear():
    values = noise(5, 4)
    u, v = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 1, 4), indexing="ij")
    corners = jnp.asarray(np.stack([u, v], -1).reshape(-1, 2))
    assert jnp.allclose(sample(values, corners).reshape(5, 4), values, atol=1e-14)
    # u v is bilinear, so that its map is exact everywhere.
    product = jnp.asarray(u * v)
    uv = noise(200, 2, seed=1)
    assert jnp.allclose(sample(product, uv), uv[:, 0] * uv[:, 1], atol=1e-14)


def test_maps_of_vectors_are_maps_of_their_channels():
    values, uv = noise(5, 4, 3), noise(40, 2, seed=1)
    found = sample(values, uv)
    for channel in range(3):
        want = sample(values[..., channel], uv)
        assert jnp.allclose(found[:, channel], want, atol=1e-14)


def test_beyond_the_scalp_the_borders_values_hold():
    values = noise(5, 4)
    outside = jnp.array([[-0.5, 1.0], [1.5, 2.0], [0.25, -1.0]])
    want = jnp.stack([values[0, 3], values[4, 3], values[1, 0]])
    assert jnp.allclose(sample(values, outside), want, atol=1e-14)


def test_gradients_of_a_map():
    check_grads(jax.jit(sample_map), (noise(4, 5, 2), jnp.array([0.41, 0.63])), order=1)


@given(st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_the_distance_of_a_stroke_is_that_of_its_closest_point(seed):
    rng = np.random.default_rng(seed)
    stroke, uv = rng.uniform(size=(4, 2)), rng.uniform(size=(9, 2))
    f = np.linspace(0.0, 1.0, 2001)[None, :, None]
    dense = (stroke[:-1, None] * (1 - f) + stroke[1:, None] * f).reshape(-1, 2)
    want = np.linalg.norm(uv[:, None] - dense[None], axis=-1).min(axis=1)
    found = distance(jnp.asarray(stroke), jnp.asarray(uv))
    assert np.allclose(found, want, atol=1e-3)


def test_a_brush_is_full_on_its_stroke_and_ends_at_its_radius():
    before = noise(21, 21)
    stroke = jnp.array([[0.2, 0.5], [0.8, 0.5]])
    after = paint(before, stroke, 0.2, 3.0)
    assert jnp.allclose(after[4:17, 10], 3.0, atol=1e-12)
    assert jnp.array_equal(after[:, :6], before[:, :6])  # 0.25 and more away
    half = 0.5 * before[10, 12] + 0.5 * 3.0  # half-way out, at 0.1
    assert jnp.allclose(after[10, 12], half, atol=1e-12)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_painted_values_lie_between_the_old_and_the_paint(value, strength, seed):
    before = noise(9, 7, seed=seed)
    stroke = noise(3, 2, seed=seed + 1)
    after = paint(before, stroke, jnp.asarray(0.4), jnp.asarray(value), strength)
    low, high = jnp.minimum(before, value), jnp.maximum(before, value)
    assert jnp.all((after >= low - 1e-12) & (after <= high + 1e-12))


def test_painting_nothing_changes_nothing():
    before = noise(9, 7)
    dab = jnp.array([[0.5, 0.5]])
    assert jnp.array_equal(paint(before, dab, 0.3, 1.0, 0.0), before)
    assert jnp.array_equal(paint(before, dab, 0.0, 1.0), before)


def test_colours_are_painted_in_all_channels():
    red = jnp.array([1.0, 0.0, 0.2])
    after = paint(noise(9, 9, 3), jnp.array([[0.5, 0.5]]), 0.2, red)
    assert jnp.allclose(after[4, 4], red, atol=1e-12)
    assert jnp.all(fill(after, red) == red[None, None])


def test_gradients_of_paint_are_finite_on_and_off_the_stroke():
    stroke = jnp.array([[0.25, 0.5], [0.75, 0.5]])

    def total(values, stroke, radius, value):
        return jnp.sum(paint(values, stroke, radius, value) ** 2)

    numbers = noise(9, 9), stroke, jnp.asarray(0.2), jnp.asarray(0.7)
    slopes = jax.jit(jax.grad(total, argnums=(0, 1, 2, 3)))(*numbers)
    assert all(jnp.all(jnp.isfinite(x)) for x in slopes)


def test_blurring_keeps_even_maps_and_limits():
    assert jnp.allclose(smooth_map(jnp.full((6, 8), 0.3), 0.2), 0.3, atol=1e-14)
    rough = noise(12, 9, 3)
    smooth = smooth_map(rough, 0.15)
    assert smooth.shape == rough.shape
    assert jnp.max(smooth) < jnp.max(rough) and jnp.min(smooth) > jnp.min(rough)
    assert jnp.std(smooth) < 0.5 * jnp.std(rough)
    assert jnp.array_equal(smooth_map(rough, 0.0), rough)


def test_the_mirror_exchanges_u_and_1_minus_u():
    values, uv = noise(6, 5), noise(30, 2, seed=1)
    mirrored = uv.at[:, 0].set(1.0 - uv[:, 0])
    want = sample(values, mirrored)
    assert jnp.allclose(sample(mirror_map(values), uv), want, atol=1e-12)
    assert jnp.array_equal(mirror_map(mirror_map(values)), values)


@pytest.mark.parametrize("rows", [6, 7])
@pytest.mark.parametrize("low", [True, False])
def test_symmetric_maps_keep_one_half(rows, low):
    values = noise(rows, 5)
    both = symmetric_map(values, low)
    assert jnp.array_equal(both, mirror_map(both))
    half = slice(0, rows // 2) if low else slice(rows - rows // 2, rows)
    assert jnp.array_equal(both[half], values[half])


def test_a_resized_map_has_the_values_of_the_old_one():
    values = noise(5, 4, 3)
    large = resize_map(values, 9, 13)  # the old texels are among the new
    assert jnp.allclose(large[::2, ::4], values, atol=1e-12)
    uv = noise(50, 2, seed=1)
    assert jnp.allclose(sample(large, uv), sample(values, uv), atol=1e-12)
    assert jnp.allclose(resize_map(large, 5, 4), values, atol=1e-12)


def test_the_density_is_the_share_of_roots_that_grow():
    maps = even_maps(5, 5)
    ramp = jnp.tile(jnp.linspace(0.0, 1.0, 5)[:, None], (1, 5))
    maps = eqx.tree_at(lambda m: m.density, maps, ramp)
    uv = noise(40_000, 2)
    kept = np.asarray(keep_roots(maps, uv, jax.random.key(0)))
    tenth = np.minimum((np.asarray(uv)[:, 0] * 10).astype(int), 9)
    for k in range(10):
        assert abs(kept[tenth == k].mean() - (k + 0.5) / 10) < 0.03


def test_bald_skin_grows_nothing_and_full_density_all():
    uv = noise(500, 2)
    bald, full = even_maps(3, 3, density=0.0), even_maps(3, 3, density=1.0)
    assert not jnp.any(keep_roots(bald, uv, jax.random.key(0)))
    assert jnp.all(keep_roots(full, uv, jax.random.key(0)))


def test_roots_keep_growing_where_density_is_painted_up():
    uv, key = noise(500, 2), jax.random.key(3)
    thin = keep_roots(even_maps(3, 3, density=0.3), uv, key)
    thick = keep_roots(even_maps(3, 3, density=0.6), uv, key)
    assert jnp.all(thick | ~thin)


def test_attributes_come_from_each_map():
    maps = even_maps(
        3, 4, density=0.5, length=0.8, thickness=5e-5, colour=(0.1, 0.2, 0.3), curl=0.01
    )
    found = root_attributes(maps, noise(6, 2))
    assert jnp.allclose(found.density, 0.5) and jnp.allclose(found.length, 0.8)
    assert jnp.allclose(found.thickness, 5e-5, rtol=1e-12)
    assert jnp.allclose(found.curl, 0.01)
    assert jnp.allclose(found.colour, jnp.array([[0.1, 0.2, 0.3]]))


def test_roots_by_density_are_even_over_area_times_density(flat):
    ramp = jnp.tile(jnp.linspace(0.0, 2.0, 6)[:, None], (1, 3))
    uv = sample_roots_by_density(flat, ramp, 20_000, jax.random.key(0))
    assert uv.shape == (20_000, 2)
    counts = np.histogram(np.asarray(uv)[:, 0], bins=10, range=(0, 1))[0] / 2000
    assert np.abs(counts - 2.0 * (np.arange(10) + 0.5) / 10).max() < 0.1
    counts = np.histogram(np.asarray(uv)[:, 1], bins=10, range=(0, 1))[0] / 2000
    assert np.abs(counts - 1.0).max() < 0.1


def test_an_even_density_samples_as_the_scalp_alone(dome):
    uv = sample_roots_by_density(dome, jnp.full((2, 2), 0.3), 4000, jax.random.key(0))
    want = sample_roots(dome, 4000, jax.random.key(1))
    for axis in range(2):
        a, b = (
            np.histogram(np.asarray(x)[:, axis], bins=8, range=(0, 1))[0]
            for x in (uv, want)
        )
        assert np.abs(a - b).max() < 130  # some four standard deviations


def test_no_density_grows_no_roots(flat):
    uv = sample_roots_by_density(flat, jnp.zeros((3, 3)), 10, jax.random.key(0))
    assert uv.shape == (0, 2)


def test_single_precision_stays_single():
    maps = jax.tree.map(lambda x: x.astype(jnp.float32), even_maps(3, 3))
    uv = noise(4, 2).astype(jnp.float32)
    assert root_attributes(maps, uv).colour.dtype == jnp.float32
    painted = paint(maps.density, uv, 0.1, 0.5)
    assert painted.dtype == jnp.float32
    assert smooth_map(painted, 0.1).dtype == jnp.float32


def test_maps_without_corners_are_refused():
    with pytest.raises(ValueError, match="at least 2 x 2 texels, its corners, got 1"):
        even_maps(1, 4)
    with pytest.raises(ValueError, match="corners, got 4 x 1"):
        resize_map(noise(3, 3), 4, 1)
