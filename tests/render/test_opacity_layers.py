"""Layers that follow the hair of each texel, and exact lists."""

import numpy as np
import pytest

from hairfit.render.opacity_exact import exact_lists
from hairfit.render.opacity_layers import Range, hair_range, layered_maps
from hairfit.render.opacity_lookup import opacity_at
from hairfit.render.opacity_maps import opacity_maps
from hairfit.render.pieces import hair_pieces
from hairfit.render.slices import uniform_slices
from hairfit.render.view import View, distant_view, lamp_view

WIDTH = 2e-4
LIGHT = np.array([0.2, 0.5, 0.8])


def waves(count: int = 200, knots: int = 9, seed: int = 0) -> np.ndarray:
    """Strands that hang about, 0.1 m wide."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, 0.005, (count, knots, 3))
    return rng.uniform(-0.05, 0.05, (count, 1, 3)) + np.cumsum(steps, 1)


def light_of(points: np.ndarray, size: int = 24, kind: str = "distant") -> View:
    make = distant_view if kind == "distant" else lamp_view
    return make(LIGHT, points.reshape(-1, 3), size)


def level(*heights: float) -> np.ndarray:
    """Sheets of strands along x at given heights, seen end to end from above."""
    across = np.linspace(-0.05, 0.05, 60)
    points = np.zeros((len(heights), 60, 2, 3))
    points[..., 2] = across[:, None]
    points[:, :, :, 1] = np.array(heights)[:, None, None]
    points[..., 0] = [-0.05, 0.05]
    return points.reshape(-1, 2, 3)


@pytest.mark.parametrize("kind", ["distant", "lamp"])
@pytest.mark.parametrize("layers", [1, 4])
def test_the_last_layer_holds_all_hair_of_its_texel(kind, layers):
    points = waves()
    view = light_of(points, kind=kind)
    whole = opacity_maps(points, WIDTH, view, np.array([0.0, 1.0])).opacity[-1]
    near, far = hair_range(hair_pieces(points, WIDTH, view), view)
    assert np.isinf(near).any() and (np.isinf(near) == (whole == 0.0)).all()
    looser = Range(near - 0.013, far + 0.02)
    tighter = Range(near + 0.01, far - 0.01)
    steps = 0.02 * np.arange(1.0, layers + 1.0)
    for maps in (
        layered_maps(points, WIDTH, view, layers),
        layered_maps(points, WIDTH, view, layers, near_far=looser),
        layered_maps(points, WIDTH, view, layers, near_far=tighter),
        layered_maps(points, WIDTH, view, layers, offsets=steps),
    ):
        np.testing.assert_allclose(maps.opacity[-1], whole, atol=1e-12)
        assert (np.diff(maps.opacity, axis=0) >= 0.0).all()
        assert (opacity_at(maps, points - 0.5 * LIGHT) >= 0.0).all()


def test_the_range_is_that_of_the_texels_hair():
    points = waves()
    view = light_of(points)
    pieces = hair_pieces(points, WIDTH, view)
    near, far = hair_range(pieces, view)
    for row, column in ((5, 7), (12, 12), (20, 3)):
        mine = (pieces.row == row) & (pieces.column == column)
        if mine.any():
            assert near[row, column] == pieces.depth[mine].min()
            assert far[row, column] == pieces.depth[mine].max()


def test_layers_with_one_sheet_each_are_exact_between_the_sheets():
    # Sheets at 3.5, 2.5, 1.5, 0.5 mm in a range from 4 to 0 mm: one in each layer.
    points = level(0.0035, 0.0025, 0.0015, 0.0005)
    view = distant_view(np.array([0.0, 1.0, 0.0]), points.reshape(-1, 3), 8, 0.0)
    all_near = np.full((8, 8), -0.004)
    given = Range(all_near, all_near + 0.004)
    maps = layered_maps(points, WIDTH, view, 4, near_far=given)
    lists = exact_lists(points, WIDTH, view)
    p = np.random.default_rng(0).uniform(-0.04, 0.04, (40, 3))
    for height in (0.004, 0.003, 0.002, 0.001, 0.0):
        p[:, 1] = height
        expected = opacity_at(lists, p)
        np.testing.assert_allclose(opacity_at(maps, p), expected, atol=1e-9)
    assert expected.min() > 0.1


@pytest.mark.parametrize("filter", ["nearest", "bilinear", "box3"])
@pytest.mark.parametrize("kind", ["distant", "lamp"])
def test_many_layers_come_to_the_exact_lists(filter, kind):
    points = waves()
    view = light_of(points, kind=kind)
    exact = opacity_at(exact_lists(points, WIDTH, view), points, filter=filter)
    errors = []
    for layers in (2, 8, 64, 512):
        maps = layered_maps(points, WIDTH, view, layers)
        found = opacity_at(maps, points, filter=filter)
        errors.append(float(np.abs(found - exact).mean() / exact.mean()))
    assert errors[0] > errors[1] > errors[2]
    assert errors[-1] < 0.03


def test_few_layers_of_each_texel_beat_as_many_slices_of_the_scene():
    # A sheet along the slope of a roof: in each texel it is thin, in the scene deep.
    points = level(0.0, -0.001, -0.002)
    points[..., 1] += 2.0 * points[..., 2]
    view = distant_view(np.array([0.0, 1.0, 0.0]), points.reshape(-1, 3), 32)
    exact = opacity_at(exact_lists(points, WIDTH, view), points)
    depth = -points[..., 1]
    slices = uniform_slices(float(depth.min()), float(depth.max()), 4)
    uniform = opacity_at(opacity_maps(points, WIDTH, view, slices), points)
    adaptive = opacity_at(layered_maps(points, WIDTH, view, 4), points)
    assert np.abs(adaptive - exact).mean() < 0.5 * np.abs(uniform - exact).mean()


def test_deep_maps_of_a_flat_front_are_plain_maps():
    points = level(0.0, -0.004, -0.005, -0.011)
    view = distant_view(np.array([0.0, 1.0, 0.0]), points.reshape(-1, 3), 16)
    offsets = np.array([0.002, 0.0045, 0.02])
    deep = layered_maps(points, WIDTH, view, 3, offsets=offsets)
    slices = np.concatenate([[0.0], offsets])
    maps = opacity_maps(points, WIDTH, view, slices)
    np.testing.assert_allclose(deep.opacity, maps.opacity[1:], atol=1e-12)
    hair = np.isfinite(deep.near)
    np.testing.assert_allclose(deep.near[hair], 0.0, atol=1e-15)
    p = np.random.default_rng(0).uniform(-0.015, 0.015, (200, 3))
    np.testing.assert_allclose(opacity_at(deep, p), opacity_at(maps, p), atol=1e-9)


def test_deep_maps_start_at_the_first_hair_of_each_texel():
    points = waves()
    view = light_of(points, kind="lamp")
    deep = layered_maps(points, WIDTH, view, 2, offsets=np.array([0.01, 0.05]))
    even = layered_maps(points, WIDTH, view, 2)
    np.testing.assert_array_equal(deep.near, even.near)
    row, column = np.argwhere(deep.opacity[0] > 0.0).T
    near = deep.near[row, column]
    at = [deep.in_texels(row, column, near + d) for d in (-0.1, 0.0, 0.005, 0.01, 9.0)]
    first, last = deep.opacity[:, row, column]
    np.testing.assert_allclose(
        at, [0 * first, 0 * first, first / 2, first, last], atol=1e-12
    )


def test_air_is_lit_in_every_map():
    points = waves(20)
    view = light_of(points)
    for maps in (
        layered_maps(points, WIDTH, view, 3),
        exact_lists(points, WIDTH, view),
    ):
        row, column = np.argwhere(
            ~np.isfinite(hair_range(hair_pieces(points, WIDTH, view), view).near)
        ).T
        assert len(row) > 50
        assert (maps.in_texels(row, column, np.full(len(row), 3.0)) == 0.0).all()


def test_exact_lists_are_plain_sums_over_the_hair_before_a_point():
    points = waves(50)
    view = light_of(points, 12)
    pieces = hair_pieces(points, WIDTH, view)
    lists = exact_lists(points, WIDTH, view)
    rng = np.random.default_rng(0)
    row, column = rng.integers(0, 12, (2, 300))
    depth = rng.uniform(-0.1, 0.1, 300)
    mine = (pieces.row == row[:, None]) & (pieces.column == column[:, None])
    before = mine & (pieces.depth.mean(1) < depth[:, None])
    expected = (before * pieces.area).sum(1)
    assert (expected > 0.0).sum() > 50
    np.testing.assert_allclose(
        lists.in_texels(row, column, depth), expected, atol=1e-12
    )


def test_the_order_of_strands_does_not_matter():
    points = waves()
    view = light_of(points)
    mixed = np.random.default_rng(1).permutation(points)[:, ::-1]
    for make in (
        lambda p: layered_maps(p, WIDTH, view, 3),
        lambda p: exact_lists(p, WIDTH, view),
    ):
        one, other = make(points), make(mixed)
        np.testing.assert_allclose(one.opacity, other.opacity, atol=1e-12)
        found = opacity_at(other, points + 1e-3)
        np.testing.assert_allclose(found, opacity_at(one, points + 1e-3), atol=1e-12)


def test_no_layers_and_offsets_that_do_not_rise_are_refused():
    points = waves(5)
    view = light_of(points)
    with pytest.raises(ValueError, match="at least 1 layer, got 0"):
        layered_maps(points, WIDTH, view, 0)
    for offsets in ([0.0, 0.1], [0.1, 0.1], [0.1]):
        with pytest.raises(ValueError, match="2 layers need as many offsets that rise"):
            layered_maps(points, WIDTH, view, 2, offsets=np.array(offsets))
