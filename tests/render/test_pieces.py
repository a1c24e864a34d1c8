"""Segments cut at the borders of pixels and of slabs."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hairfit.render.pieces import Pieces, cut_at_depths, hair_pieces, strips_needed
from hairfit.render.view import View, distant_view, lamp_view, see_all

WIDTH = 1e-4


def flat_view(size: int = 8, scale: float = 100.0) -> View:
    """A far light along z, whose pixel is x and y times the scale."""
    matrix = jnp.diag(jnp.array([scale, scale, 1.0, 0.0])).at[3, 3].set(1.0)
    return View(matrix, jnp.asarray(scale), size, size)


def strand(*knots) -> np.ndarray:
    """One strand, knot by knot: pixels of `flat_view` and depth."""
    return np.array([knots], float) / np.array([100.0, 100.0, 1.0])


def waves(count: int = 40, knots: int = 9, seed: int = 0) -> np.ndarray:
    """Strands that hang about, 0.1 m wide."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, 0.005, (count, knots, 3))
    return rng.uniform(-0.05, 0.05, (count, 1, 3)) + np.cumsum(steps, 1)


def by_pixel(pieces: Pieces, size: int) -> np.ndarray:
    picture = np.zeros((size, size))
    np.add.at(picture, (pieces.row, pieces.column), pieces.area)
    return picture


def test_a_slanted_segment_is_cut_where_a_hand_would_cut_it():
    # From (0.5, 0.5) to (2.5, 1.5): borders x = 1 and 2 at t = 1/4, 3/4; y = 1 at 1/2.
    pieces = hair_pieces(strand([0.5, 0.5, 1.0], [2.5, 1.5, 3.0]), WIDTH, flat_view())
    assert pieces.column.tolist() == [0, 1, 1, 2] and pieces.row.tolist() == [
        0,
        0,
        1,
        1,
    ]
    np.testing.assert_allclose(pieces.start, [0.0, 0.25, 0.5, 0.75], atol=1e-12)
    np.testing.assert_allclose(pieces.end, [0.25, 0.5, 0.75, 1.0], atol=1e-12)
    np.testing.assert_allclose(pieces.depth[1], [1.5, 2.0], atol=1e-12)
    np.testing.assert_allclose(pieces.area, 0.01 * np.sqrt(5.0) / 4, rtol=1e-12)


def test_a_segment_is_clipped_to_the_picture_but_keeps_its_own_parameter():
    # 16 pixels long, of which [0, 8] lie in the picture, from t = 1/4 to 3/4.
    pieces = hair_pieces(strand([-4, 3.5, 1.0], [12, 3.5, 2.0]), WIDTH, flat_view())
    assert pieces.column.tolist() == list(range(8)) and set(pieces.row) == {3}
    assert pieces.start[0] == pytest.approx(0.25)
    assert pieces.end[-1] == pytest.approx(0.75)
    assert pieces.depth[0, 0] == pytest.approx(1.25)
    assert pieces.area.sum() == pytest.approx(0.01 * 8.0)


@pytest.mark.parametrize(
    "ends",
    [
        ([-1, 2, 1], [-0.5, 6, 1]),  # beside
        ([-2, 1, 1], [1, -2, 1]),  # past a corner
        ([3, 3, 1], [3, 3, 2]),  # end on
        ([2, 2, 1], [2, 2, 1]),  # a point
    ],
)
def test_what_covers_nothing_has_no_pieces(ends):
    assert len(hair_pieces(strand(*ends), WIDTH, flat_view()).area) == 0


def test_a_segment_behind_a_lamp_is_dropped_whole():
    view = lamp_view(np.array([0.0, 0.0, 0.5]), waves().reshape(-1, 3), 32)
    behind = np.array([[[0.0, 0.0, 0.0], [0.01, 0.0, 0.8], [0.02, 0.0, 0.9]]])
    assert (see_all(behind, view)[0, 1:, 3] == 0.0).all()
    assert len(hair_pieces(behind, WIDTH, view).area) == 0


@pytest.mark.parametrize("kind", ["distant", "lamp"])
def test_areas_sum_to_width_times_length_times_scale(kind):
    points = waves()
    light = np.array([0.1, 0.3, 0.9])
    make = distant_view if kind == "distant" else lamp_view
    view = make(light, points.reshape(-1, 3), 48)
    seen = see_all(points, view)
    length = np.linalg.norm(np.diff(seen[..., :2], axis=1), axis=2)
    scale = 0.5 * (seen[:, 1:, 3] + seen[:, :-1, 3])
    whole = (WIDTH * scale * length).reshape(-1)
    pieces = hair_pieces(points, WIDTH, view)
    found = np.bincount(pieces.segment, pieces.area, len(whole))
    np.testing.assert_allclose(found, whole, rtol=1e-12)
    # And of each segment the pieces follow one another from end to end.
    same = pieces.segment[1:] == pieces.segment[:-1]
    assert (pieces.start[1:] == pieces.end[:-1])[same].all()
    assert (pieces.start[1:][~same] == 0.0).all() and (
        pieces.end[:-1][~same] == 1
    ).all()


# Sixteenths: many lines then pass through corners and along borders.
coordinate = st.integers(-48, 176).map(lambda k: k / 16)


@settings(max_examples=200, deadline=None)
@given(coordinate, coordinate, coordinate, coordinate)
def test_every_piece_lies_in_its_pixel_and_no_length_is_lost(ax, ay, bx, by):
    points = strand([ax, ay, 1.0], [bx, by, 2.0])
    pieces = hair_pieces(points, WIDTH, flat_view())
    a, b = np.array([ax, ay]), np.array([bx, by])
    for t in (pieces.start, pieces.end):
        at = a + t[:, None] * (b - a)
        pixel = np.stack([pieces.column, pieces.row], 1)
        assert (at > pixel - 1e-9).all() and (at < pixel + 1 + 1e-9).all()
    t = np.linspace(0.0, 1.0, 4001)[:, None]
    inside = ((a + t * (b - a) > 0.0) & (a + t * (b - a) < 8.0)).all(1).mean()
    found = float((pieces.end - pieces.start).sum())
    on_border = (ax == bx and ax in (0.0, 8.0)) or (ay == by and ay in (0.0, 8.0))
    if not on_border and (a != b).any():
        assert found == pytest.approx(inside, abs=1e-3)


def test_segments_are_counted_from_the_root_of_the_first_strand():
    points = waves(count=3, knots=4)
    view = distant_view(np.array([0.0, 0.0, 1.0]), points.reshape(-1, 3), 16)
    pieces = hair_pieces(points, WIDTH, view)
    second = hair_pieces(points[1:2], WIDTH, view)
    mine = np.isin(pieces.segment, [3, 4, 5])
    assert set(pieces.segment) == set(range(9))
    np.testing.assert_array_equal(pieces.segment[mine] - 3, second.segment)
    np.testing.assert_array_equal(pieces.area[mine], second.area)


def test_strips_fill_an_upright_rectangle():
    # 2 pixels wide, from x = 2.25 to 4.25 and y = 1 to 6.
    points = strand([3.25, 1.0, 1.0], [3.25, 6.0, 1.0])
    view = flat_view()
    strips = 64
    picture = by_pixel(hair_pieces(points, 0.02, view, strips), 8)
    expected = np.zeros((8, 8))
    expected[1:6, 2:5] = [0.75, 1.0, 0.25]
    np.testing.assert_allclose(picture, expected, atol=1e-12)
    assert strips_needed(points, 0.02, view) == 8
    assert strips_needed(points, 0.001, view) == 1
    assert set(hair_pieces(points, 0.02, view, 4).segment) == {0}


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(0.5, 3.5), max_size=6).map(sorted))
def test_slabs_sum_to_the_whole_and_lie_where_a_plain_cut_finds_them(borders):
    points = np.concatenate([strand([0.5, 0.5, 1.0], [6.5, 5.5, 3.0]), waves(1, 2)])
    pieces = hair_pieces(points, WIDTH, flat_view())
    borders = np.array(borders)
    parts = cut_at_depths(pieces, borders)
    back = np.bincount(parts.piece, parts.area, len(pieces.area))
    np.testing.assert_allclose(back, pieces.area, atol=1e-15)
    # The same cut at the same borders, given piece by piece.
    rows = np.tile(borders, (len(pieces.area), 1))
    for one, other in zip(parts, cut_at_depths(pieces, rows), strict=True):
        np.testing.assert_array_equal(one, other)
    edges = np.concatenate([[-np.inf], borders, [np.inf]])
    low, high = pieces.depth.min(1), pieces.depth.max(1)
    for slab in range(len(borders) + 1):
        share = np.clip(high, edges[slab], edges[slab + 1]) - np.clip(
            low, edges[slab], edges[slab + 1]
        )
        expected = (pieces.area * share / (high - low)).sum()
        assert parts.area[parts.slab == slab].sum() == pytest.approx(
            expected, abs=1e-12
        )


def test_level_hair_on_a_border_lies_in_the_slab_behind_it():
    pieces = hair_pieces(strand([1.2, 1.5, 2.0], [1.8, 1.5, 2.0]), WIDTH, flat_view())
    parts = cut_at_depths(pieces, np.array([1.0, 2.0, 3.0]))
    assert parts.slab.tolist() == [2]


def test_no_strips_are_refused():
    with pytest.raises(ValueError, match="at least 1 strip, got 0"):
        hair_pieces(waves(), WIDTH, flat_view(), 0)
