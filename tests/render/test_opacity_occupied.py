"""Opacity in layers where texels have hair."""

import numpy as np
import pytest

from hairfit.render.opacity_layers import Range
from hairfit.render.opacity_lookup import opacity_at
from hairfit.render.opacity_maps import opacity_maps
from hairfit.render.opacity_occupied import (
    SLABS,
    first_rank,
    layer_of_rank,
    occupied_maps,
    within,
)
from hairfit.render.pieces import hair_pieces
from hairfit.render.slices import uniform_slices
from hairfit.render.view import distant_view

WIDTH = 0.001
ENDS = (-0.1, 0.1)


def far_apart(count=60):
    """Return level hair at the near end and at the far end of a range."""
    rng = np.random.default_rng(0)
    height = np.where(np.arange(count) % 2 == 0, 0.095, -0.095)
    height = height + 0.004 * rng.uniform(-1.0, 1.0, count)
    x = np.linspace(-0.05, 0.05, 7)
    z = rng.uniform(-0.05, 0.05, count)
    return np.stack(np.broadcast_arrays(x, height[:, None], z[:, None]), -1)


def view_of(points, size=32):
    return distant_view(np.array([0.0, 1.0, 0.0]), points.reshape(-1, 3), size)


def test_few_slabs_have_a_layer_each():
    points = far_apart()
    view = view_of(points)
    maps = occupied_maps(points, WIDTH, view, ENDS, 16)
    assert maps.occupied.sum(0).max() <= 16
    even = opacity_maps(points, WIDTH, view, uniform_slices(*ENDS, SLABS))
    p = np.random.default_rng(1).uniform(-0.12, 0.12, (500, 3))
    np.testing.assert_allclose(opacity_at(maps, p), opacity_at(even, p), atol=1e-12)


@pytest.mark.parametrize("layers", [1, 3, 8])
def test_fewer_layers_hold_all_hair_and_the_nearest_exactly(layers):
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.09, 0.09, (3000, 2, 3))
    points[:, 1] = points[:, 0] + 0.01 * rng.normal(size=(3000, 3))
    view = view_of(points, 12)
    maps = occupied_maps(points, WIDTH, view, ENDS, layers)
    number = maps.occupied.sum(0)
    assert (number > layers).mean() > 0.3
    area = hair_pieces(points, WIDTH, view).area.sum()
    assert maps.opacity[-1].sum() == pytest.approx(area, rel=1e-12)
    even = opacity_maps(points, WIDTH, view, uniform_slices(*ENDS, SLABS))
    # Down to the end of the slabs with a layer of their own, both are the same.
    row, column = np.argwhere(number > layers)[0]
    slab = np.flatnonzero(maps.occupied[:, row, column])
    for k in range(layers // 2):
        end = np.array([maps.borders[slab[k] + 1]])
        at = np.array([row]), np.array([column]), end
        assert maps.in_texels(*at) == pytest.approx(even.in_texels(*at), abs=1e-12)


def test_opacity_never_falls_with_depth():
    points = far_apart(400)
    maps = occupied_maps(points, WIDTH, view_of(points, 16), ENDS, 4)
    depth = np.linspace(-0.12, 0.12, 400)
    for row, column in ((3, 3), (8, 11)):
        at = np.full(400, row), np.full(400, column)
        found = maps.in_texels(*at, depth)
        assert (np.diff(found) >= -1e-12).all()
        assert found[0] == 0.0
        assert found[-1] == pytest.approx(maps.opacity[-1, row, column])


def test_layers_share_ranks_without_gaps():
    for number in range(1, 90):
        for layers in (2, 5, 16):
            rank = np.arange(number)
            layer = layer_of_rank(rank, np.full(number, number), layers)
            assert layer.min() == 0 and layer.max() == min(number, layers) - 1
            assert set(np.diff(layer)) <= {0, 1}
            first = first_rank(layer, np.full(number, number), layers)
            expected = [np.flatnonzero(layer == k)[0] for k in layer]
            np.testing.assert_array_equal(first, expected)


def test_a_given_range_is_taken_for_occupied():
    near = np.array([[-0.05, np.inf]])
    far = np.array([[0.0, -np.inf]])
    held = within(Range(near, far), uniform_slices(*ENDS, SLABS))
    assert held[:, 0, 0].sum() == SLABS // 4 + 1
    assert held[24, 0, 0] and not held[23, 0, 0] and not held[49, 0, 0]
    assert held[:, 0, 1].all()


def test_no_layer_is_refused():
    points = far_apart()
    with pytest.raises(ValueError, match="at least 1 layer, got 0"):
        occupied_maps(points, WIDTH, view_of(points), ENDS, 0)
