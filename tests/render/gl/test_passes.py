"""Opacity shadow maps drawn as lines, against the float64 reference."""

import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render.gl.passes import LineMaps, maps_by_passes, maps_by_targets
from hairfit.render.opacity_lookup import Filter, opacity_at, transmittance
from hairfit.render.opacity_maps import opacity_maps
from hairfit.render.slices import gamma_slices, uniform_slices
from hairfit.render.view import View, distant_view, lamp_view, see_all

WIDTH = 0.0008
BOTH = pytest.mark.parametrize("ways", [maps_by_passes, maps_by_targets])


def a_view(kind: str, strands: np.ndarray, size: int) -> View:
    flat = strands.reshape(-1, 3)
    if kind == "lamp":
        return lamp_view(np.array([0.3, 0.5, 0.4]), flat, size)
    return distant_view(np.array([0.3, 0.8, 0.5]), flat, size)


def depths(strands: np.ndarray, view: View, count: int, scheme=uniform_slices):
    depth = see_all(strands, view)[..., 2]
    return scheme(float(depth.min()), float(depth.max()), count)


def level_view(size: int = 16) -> View:
    """Parallel rays along z; a pixel is a centimetre."""
    matrix = jnp.diag(jnp.array([100.0, 100.0, 1.0, 0.0])).at[3, 3].set(1.0)
    return View(matrix, jnp.asarray(100.0), size, size)


@pytest.mark.parametrize("kind", ["distant", "lamp"])
@pytest.mark.parametrize("count", [5, 32, 70])
def test_passes_and_targets_make_the_same_maps(context, bob, kind, count):
    view = a_view(kind, bob, 96)
    slices = depths(bob, view, count, gamma_slices)
    one = maps_by_passes(context, bob, WIDTH, view, slices)
    other = maps_by_targets(context, bob, WIDTH, view, slices)
    assert one.opacity.shape == (count + 1, 96, 96)
    assert (one.opacity[0] == 0.0).all() and one.opacity.max() > 1.0
    np.testing.assert_allclose(other.opacity, one.opacity, atol=2e-6)
    np.testing.assert_array_equal(one.slices, slices)


@BOTH
@pytest.mark.parametrize("kind", ["distant", "lamp"])
def test_light_that_reaches_the_hair_is_near_the_references(context, bob, kind, ways):
    view = a_view(kind, bob, 96)
    slices = depths(bob, view, 32)
    maps = ways(context, bob, WIDTH, view, slices)
    expected = opacity_maps(bob, WIDTH, view, slices)
    # Lines one pixel wide put into one pixel what should be shared by two; the average
    # of 3 x 3 texels makes up for it.
    limits: tuple[tuple[Filter, float], ...] = (("box3", 0.015), ("bilinear", 0.045))
    for filter, most in limits:
        light = [
            transmittance(opacity_at(m, bob, filter=filter)) for m in (maps, expected)
        ]
        assert light[1].min() < 0.3
        assert np.sqrt(np.mean((light[0] - light[1]) ** 2)) < most


@BOTH
def test_each_slab_holds_the_references_sum(context, bob, ways):
    view = a_view("distant", bob, 192)
    slices = depths(bob, view, 12)
    maps = ways(context, bob, WIDTH, view, slices)
    expected = opacity_maps(bob, WIDTH, view, slices)
    found, true = (
        np.diff(m.opacity.sum((1, 2), dtype=np.float64)) for m in (maps, expected)
    )
    assert found.sum() == pytest.approx(true.sum(), rel=0.005)
    assert np.abs(found - true).max() < 0.02 * true.mean()


@BOTH
def test_a_level_strand_gives_exact_sums(context, ways):
    # From x = 2 to 10 in row 5, and down through the depths.
    x = np.linspace(0.02, 0.10, 5)
    strand = np.stack([x, np.full(5, 0.055), np.linspace(1.0, 1.4, 5)], -1)[None]
    slices = np.array([1.0, 1.1, 1.15, 1.2, 1.4])
    view = level_view()
    maps = ways(context, strand, 0.003, view, slices)
    expected = opacity_maps(strand, 0.003, view, slices)
    np.testing.assert_allclose(maps.opacity, expected.opacity, atol=2e-6)
    np.testing.assert_allclose(maps.opacity[-1, 5, 2:10], 0.3, atol=1e-6)
    assert maps.opacity[-1].sum() == pytest.approx(0.3 * 8, abs=1e-5)
    assert (np.diff(maps.opacity, axis=0) >= 0.0).all()


@BOTH
def test_the_order_of_strands_does_not_matter(context, bob, ways):
    view = a_view("distant", bob, 64)
    slices = depths(bob, view, 8)
    one = ways(context, bob, WIDTH, view, slices)
    other = ways(context, bob[::-1], WIDTH, view, slices)
    np.testing.assert_allclose(one.opacity, other.opacity, atol=2e-6)


def test_one_set_of_buffers_serves_lights_and_sizes_in_turn(context, bob):
    lines = LineMaps(context, bob, WIDTH)
    for kind, size, count in (("lamp", 32, 8), ("distant", 48, 33), ("lamp", 32, 8)):
        view = a_view(kind, bob, size)
        slices = depths(bob, view, count)
        own = lines.by_passes(view, slices).opacity
        alone = maps_by_passes(context, bob, WIDTH, view, slices).opacity
        np.testing.assert_array_equal(own, alone)
        np.testing.assert_allclose(
            lines.by_targets(view, slices).opacity, own, atol=2e-6
        )
    lines.release()


@BOTH
def test_hair_behind_the_lamp_is_left_out(context, ways):
    strand = np.array([[[0.0, 0.0, z] for z in (-0.5, -0.2, 0.5, 0.6)]])
    strand[..., 0] = np.linspace(0.0, 0.02, 4)
    view = lamp_view(np.zeros(3), np.array([[0.0, -0.1, 1.0], [0.1, 0.1, 1.1]]), 32)
    maps = ways(context, strand, WIDTH, view, np.array([0.4, 0.6]))
    expected = opacity_maps(strand, WIDTH, view, np.array([0.4, 0.6]))
    assert expected.opacity.sum() > 0.0
    total = pytest.approx(expected.opacity.sum(), rel=0.5)
    assert maps.opacity.sum(dtype=np.float64) == total


@BOTH
def test_one_depth_is_refused(context, bob, ways):
    with pytest.raises(ValueError, match="at least 2 depths, got 1"):
        ways(context, bob, WIDTH, level_view(), np.array([1.0]))
