"""Opacity shadow maps of fixed slices against table 6-1, a loop and closed forms."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from hairfit.render.opacity_exact import exact_lists
from hairfit.render.opacity_layers import layered_maps
from hairfit.render.opacity_lookup import (
    axis_taps,
    kappa_of_bits,
    opacity_at,
    taps,
    transmittance,
)
from hairfit.render.opacity_maps import OpacityMaps, opacity_maps
from hairfit.render.pieces import hair_pieces
from hairfit.render.slices import gamma_slices, uniform_slices
from hairfit.render.view import View, distant_view, lamp_view, light_axes, see_all

WIDTH = 2e-4
LIGHT = np.array([0.2, 0.5, 0.8])


def waves(count: int = 200, knots: int = 9, seed: int = 0) -> np.ndarray:
    """Strands that hang about, 0.1 m wide."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, 0.005, (count, knots, 3))
    return rng.uniform(-0.05, 0.05, (count, 1, 3)) + np.cumsum(steps, 1)


def fibres(count: int, seed: int = 0) -> np.ndarray:
    """Fibres along x, spread evenly over the cube [-0.05, 0.05]^3 and through it."""
    rng = np.random.default_rng(seed)
    points = np.zeros((count, 2, 3))
    points[..., 1:] = rng.uniform(-0.05, 0.05, (count, 1, 2))
    points[:, :, 0] = [-0.05, 0.05]
    return points


def light_of(points: np.ndarray, size: int = 24, kind: str = "distant") -> View:
    make = distant_view if kind == "distant" else lamp_view
    return make(LIGHT, points.reshape(-1, 3), size)


def depths(points: np.ndarray, view: View, count: int) -> np.ndarray:
    depth = see_all(points, view)[..., 2]
    return uniform_slices(float(depth.min()), float(depth.max()), count)


def table_6_1(
    points: np.ndarray, width: float, view: View, slices: np.ndarray
) -> np.ndarray:
    """Line by line: the buffer after each pass over all hair, clipped to one slab."""
    pieces = hair_pieces(points, width, view)
    low, high = pieces.depth.min(1), pieces.depth.max(1)
    buffer = np.zeros((view.height, view.width))
    maps = [buffer.copy()]
    for i in range(1, len(slices)):
        front = -np.inf if i == 1 else slices[i - 1]
        back = np.inf if i == len(slices) - 1 else slices[i]
        inside = np.minimum(high, back) - np.maximum(low, front)
        level = high == low
        share = np.maximum(inside, 0.0) / np.where(level, 1.0, high - low)
        share = np.where(level, (low >= front) & (low < back), share)
        np.add.at(buffer, (pieces.row, pieces.column), share * pieces.area)
        maps.append(buffer.copy())
    return np.stack(maps)


@pytest.mark.parametrize("kind", ["distant", "lamp"])
def test_one_histogram_is_the_loop_of_table_6_1(kind):
    points = waves()
    view = light_of(points, kind=kind)
    slices = depths(points, view, 7)
    slices[0] += 0.02  # some hair lies before the first and behind the last map
    slices[-1] -= 0.02
    found = opacity_maps(points, WIDTH, view, slices)
    expected = table_6_1(points, WIDTH, view, slices)
    np.testing.assert_allclose(found.opacity, expected, atol=1e-12)
    whole = hair_pieces(points, WIDTH, view).area.sum()
    assert found.opacity[-1].sum() == pytest.approx(whole, rel=1e-12)
    assert (found.opacity[0] == 0.0).all()


def test_the_order_of_strands_does_not_matter():
    points = waves()
    view = light_of(points)
    slices = depths(points, view, 5)
    mixed = np.random.default_rng(1).permutation(points)
    one, other = (
        opacity_maps(p, WIDTH, view, slices) for p in (points, mixed[:, ::-1])
    )
    np.testing.assert_allclose(one.opacity, other.opacity, atol=1e-12)


@pytest.mark.parametrize("filter", ["nearest", "bilinear", "box3"])
@pytest.mark.parametrize("kind", ["distant", "lamp"])
def test_many_maps_come_to_the_exact_lists(filter, kind):
    points = waves()
    view = light_of(points, kind=kind)
    exact = opacity_at(exact_lists(points, WIDTH, view), points, filter=filter)
    errors = []
    for count in (4, 32, 256, 2048):
        maps = opacity_maps(points, WIDTH, view, depths(points, view, count))
        found = opacity_at(maps, points, filter=filter)
        errors.append(float(np.abs(found - exact).mean() / exact.mean()))
    assert errors[0] > 2.0 * errors[1] > 4.0 * errors[2]
    # What is left: a list takes a piece whole at its middle, maps take it bit by bit.
    assert errors[-1] < 0.03


def test_a_cube_of_parallel_fibres_dims_light_by_the_exponential_law():
    # N fibres of width w and length a in a cube of side a: w N a / a^3 per metre.
    count, side = 60_000, 0.1
    sigma = WIDTH * count / side**2
    points = fibres(count)
    view = distant_view(np.array([0.0, 0.0, 1.0]), points.reshape(-1, 3), 16, 0.0)
    maps = opacity_maps(points, WIDTH, view, depths(points, view, 16))
    lists = exact_lists(points, WIDTH, view)
    z = np.linspace(0.045, -0.045, 7)
    p = np.stack([np.full(7, 0.01), np.full(7, -0.005), z], 1)
    law = np.exp(-0.03 * sigma * (side / 2 - z))
    assert law.min() < 0.05 and law.max() > 0.8
    for found in (maps, lists):
        lit = transmittance(opacity_at(found, p, filter="box3"), 0.03)
        np.testing.assert_allclose(lit, law, atol=0.015)


def test_light_is_full_before_the_hair_and_the_last_map_holds_behind_it():
    points = waves()
    view = light_of(points)
    maps = opacity_maps(points, WIDTH, view, depths(points, view, 6))
    away = np.asarray(view.matrix)[2, :3]
    for interpolation in ("linear", "cubic"):
        before = opacity_at(maps, points - 0.4 * away, interpolation=interpolation)
        assert (np.abs(before) < 1e-12).all()
        found = opacity_at(maps, points + 0.4 * away, interpolation=interpolation)
        flat = maps._replace(opacity=np.tile(maps.opacity[-1], (7, 1, 1)))
        np.testing.assert_allclose(found, opacity_at(flat, points), atol=1e-12)


def test_interpolation_is_linear_between_two_maps():
    view = light_of(waves())
    slices = np.array([1.0, 1.1, 1.4])
    opacity = np.array([0.0, 2.0, 3.0])[:, None, None] * np.ones((1, 24, 24))
    maps = OpacityMaps(view, slices, opacity)
    depth = np.array([0.9, 1.0, 1.05, 1.1, 1.2, 1.4, 2.0])
    at = np.full(7, 3)
    found = maps.in_texels(at, at, depth)
    np.testing.assert_allclose(found, np.interp(depth, slices, [0.0, 2.0, 3.0]))


rises = st.lists(st.floats(0.0, 3.0), min_size=1, max_size=9)


@settings(max_examples=60, deadline=None)
@example([1e-313], 0)  # its inverse overflows
@given(rises, st.integers(0, 99))
def test_the_cubic_meets_its_maps_and_never_falls_or_overshoots(rise, seed):
    opacity = np.concatenate([[0.0], np.cumsum(rise)])
    thick = np.random.default_rng(seed).uniform(0.01, 0.5, len(rise))
    slices = np.cumsum(np.concatenate([[1.0], thick]))
    maps = OpacityMaps(light_of(waves()), slices, opacity[:, None, None])
    fine = np.sort(np.concatenate([slices, np.linspace(0.9, slices[-1] + 0.1, 600)]))
    zero = np.zeros(len(fine), int)
    found = maps.in_texels_cubic(zero, zero, fine)
    assert (np.diff(found) >= -1e-12).all()
    zero = np.zeros(len(slices), int)
    at_maps = maps.in_texels_cubic(zero, zero, slices)
    np.testing.assert_allclose(at_maps, opacity, atol=1e-12)


def test_the_cubic_is_scipys_between_inner_maps():
    rng = np.random.default_rng(0)
    slices = np.cumsum(rng.uniform(0.05, 0.5, 12))
    opacity = np.cumsum(rng.uniform(0.0, 1.0, 12) * rng.integers(0, 2, 12))
    maps = OpacityMaps(light_of(waves()), slices, opacity[:, None, None])
    fine = np.linspace(slices[1], slices[-2], 200)
    zero = np.zeros(200, int)
    expected = PchipInterpolator(slices, opacity)(fine)
    np.testing.assert_allclose(
        maps.in_texels_cubic(zero, zero, fine), expected, atol=1e-12
    )


def test_the_cubic_keeps_straight_lines_straight_and_is_smooth_where_linear_is_not():
    view = light_of(waves())
    slices = gamma_slices(1.0, 2.0, 6)
    fine = np.linspace(slices[1], slices[-2], 101)
    zero = np.zeros(101, int)
    line = OpacityMaps(view, slices, (3.0 * (slices - 1.0))[:, None, None])
    found = line.in_texels_cubic(zero, zero, fine)
    np.testing.assert_allclose(found, 3.0 * (fine - 1.0), atol=1e-12)
    curve = OpacityMaps(view, slices, ((slices - 1.0) ** 2)[:, None, None])
    error = {
        find: np.abs(getattr(curve, find)(zero, zero, fine) - (fine - 1.0) ** 2).max()
        for find in ("in_texels", "in_texels_cubic")
    }
    assert error["in_texels_cubic"] < 0.5 * error["in_texels"]


def test_cubic_needs_fixed_maps():
    points = waves(5)
    view = light_of(points)
    for maps in (
        exact_lists(points, WIDTH, view),
        layered_maps(points, WIDTH, view, 2),
    ):
        with pytest.raises(ValueError, match="cubic interpolation needs `OpacityMaps`"):
            opacity_at(maps, points, interpolation="cubic")


@pytest.mark.parametrize("filter", ["nearest", "bilinear", "box3"])
def test_weights_sum_to_one_and_keep_a_picture_that_is_a_ramp(filter):
    pixel = np.random.default_rng(0).uniform(3.0, 9.0, (50, 2))
    total, x = np.zeros(50), np.zeros(50)
    for tap in taps(pixel, (12, 12), filter):
        total += tap.weight
        x += tap.weight * (tap.column + 0.5)
    np.testing.assert_allclose(total, 1.0, atol=1e-12)
    if filter != "nearest":
        np.testing.assert_allclose(x, pixel[:, 0], atol=1e-12)


def test_box3_at_a_centre_is_the_mean_of_nine_texels():
    index, weight = axis_taps(np.array([5.5]), "box3")
    np.testing.assert_allclose(weight[:, 0], [1 / 3, 1 / 3, 1 / 3, 0.0])
    assert index[:, 0].tolist() == [4, 5, 6, 7]


def test_points_beside_the_picture_take_its_border_and_those_behind_a_lamp_are_lit():
    points = waves()
    view = light_of(points, kind="lamp")
    dark = np.ones((1, view.height, view.width))
    maps = OpacityMaps(view, np.array([0.0, 1e-9]), np.concatenate([0 * dark, dark]))
    beside = points + light_axes(LIGHT)[0]
    assert (np.abs(see_all(beside, view)[..., 0] - 12.0) > 24.0).all()
    np.testing.assert_allclose(opacity_at(maps, beside), 1.0, atol=1e-12)
    assert (opacity_at(maps, LIGHT[None] * 2.0) == 0.0).all()


def test_eight_bits_are_full_at_an_opacity_of_one():
    assert kappa_of_bits(8) == pytest.approx(5.545, abs=5e-4)
    one = transmittance(np.ones(1), kappa_of_bits(8))
    assert float(one[0]) == pytest.approx(1 / 256)


def test_one_depth_makes_no_maps():
    points = waves(5)
    with pytest.raises(ValueError, match="at least 2 depths, got 1"):
        opacity_maps(points, WIDTH, light_of(points), np.array([1.0]))
