"""The order of drawing, and blending against closed forms and by hand."""

import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render import Camera
from hairfit.render.pieces import hair_pieces
from hairfit.render.view import View, camera_view, see_all
from hairfit.render.visibility import composite, visibility_bins

RED, BLUE = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def camera(size: int = 32) -> View:
    """A camera at z = -1 m that looks along z."""
    K = jnp.array([[250.0, 0.0, size / 2], [0.0, 250.0, size / 2], [0.0, 0.0, 1.0]])
    pose = jnp.eye(4).at[2, 3].set(1.0)
    return camera_view(Camera(K, pose, size, size))


def flat_view(size: int = 8, scale: float = 100.0) -> View:
    """A far eye along z, whose pixel is x and y times the scale."""
    matrix = jnp.diag(jnp.array([scale, scale, 1.0, 0.0])).at[3, 3].set(1.0)
    return View(matrix, jnp.asarray(scale), size, size)


def strand(*knots) -> np.ndarray:
    """One strand, knot by knot: pixels of `flat_view` and depth."""
    return np.array([knots], float) / np.array([100.0, 100.0, 1.0])


def across(depths: list[float]) -> np.ndarray:
    """Strands of two segments that run level through pixels (1, 2) to (5, 2)."""
    each = [strand([1, 2.5, z], [3, 2.5, z], [6, 2.5, z]) for z in depths]
    return np.concatenate(each)


def waves(count: int, knots: int = 33, seed: int = 0) -> np.ndarray:
    """Strands that hang in curls, 0.1 m wide."""
    rng = np.random.default_rng(seed)
    root = rng.uniform(-0.04, 0.04, (count, 1, 3))
    t = np.linspace(0.0, 1.0, knots)[None] + rng.uniform(0.0, 1.0, (count, 1))
    curl = np.stack([np.cos(9 * t), 4.0 * t, np.sin(9 * t)], 2)
    return root + 0.02 * curl


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(-10.0 * np.log10(np.mean((one - other) ** 2)))


def test_a_segment_is_in_the_bin_of_its_farther_end_and_the_farthest_comes_first():
    one = strand([0, 0, 0], [0, 0, 3.5], [0, 0, 1])
    points = np.concatenate([one, strand([0, 0, 10], [0, 0, 8], [0, 0, 1])])
    found = visibility_bins(points, flat_view(), 10)
    assert found.bin.tolist() == [3, 3, 9, 7]
    assert found.order.tolist() == [2, 3, 0, 1]


def test_floor_keeps_every_bin_below_their_number():
    # The ceiling that (6-3) prints would give 512 for the farthest point.
    points = waves(50)
    view = camera()
    found = visibility_bins(points, view)
    assert found.bin.max() == 511 and found.bin.min() >= 0
    seen = see_all(points, view)[..., 2]
    low, high = seen.min(), seen.max()
    edge = low + (high - low) * np.arange(513) / 512
    farther = np.maximum(seen[:, 1:], seen[:, :-1]).reshape(-1)
    thin = 1e-5 * (high - low)
    assert (farther >= edge[found.bin] - thin).all()
    assert (farther <= edge[found.bin + 1] + thin).all()
    assert (np.diff(found.bin[found.order]) <= 0).all()
    assert sorted(found.order) == list(range(50 * 32))


def test_equal_bins_keep_the_order_of_segments():
    found = visibility_bins(across([2.0, 2.0, 2.0]), flat_view())
    assert found.bin.tolist() == [0] * 6
    assert found.order.tolist() == list(range(6))


def test_two_hairs_that_overlap_blend_as_by_hand():
    # Far red and near blue; each covers 0.3 of a pixel, times 0.5.
    view = flat_view()
    points = across([2.0, 1.0])
    pieces = hair_pieces(points, 0.003, view)
    colour = np.where(pieces.segment[:, None] < 2, RED, BLUE)
    drawn = visibility_bins(points, view).order
    for order in (drawn, None):
        found = composite(pieces, colour, 0.5, view, order)
        np.testing.assert_allclose(
            found.colour[2, 4], 0.15 * BLUE + 0.85 * 0.15 * RED, atol=1e-12
        )
        assert found.coverage[2, 4] == pytest.approx(1.0 - 0.85**2)
    # Drawn the other way round red lies over blue.
    found = composite(pieces, colour, 0.5, view, drawn[::-1])
    np.testing.assert_allclose(
        found.colour[2, 4], 0.15 * RED + 0.85 * 0.15 * BLUE, atol=1e-12
    )


@pytest.mark.parametrize("alpha", [0.09, 0.25, 0.6, 1.0])
def test_coverage_of_many_hairs_is_one_minus_the_power_of_what_each_lets_through(alpha):
    view = flat_view()
    for width, area in ((0.004, 0.4), (0.02, 1.0)):  # the latter fills its pixel
        pieces = hair_pieces(across(list(np.linspace(1.0, 2.0, 7))), width, view)
        ones = np.ones((len(pieces.area), 3))
        found = composite(pieces, ones, alpha, view)
        expected = np.zeros((8, 8))
        expected[2, 1:6] = 1.0 - (1.0 - area * alpha) ** 7
        np.testing.assert_allclose(found.coverage, expected, atol=1e-12)
        # White hair is as bright as it covers, in whichever order it is drawn.
        np.testing.assert_allclose(found.colour[..., 1], found.coverage, atol=1e-12)


def test_coverage_does_not_depend_on_the_order_but_colour_does():
    points = waves(100)
    view = camera()
    pieces = hair_pieces(points, 2e-3, view)
    colour = np.random.default_rng(1).uniform(0.0, 1.0, (len(pieces.area), 3))
    order = visibility_bins(points, view).order
    one = composite(pieces, colour, 0.8, view, order)
    other = composite(pieces, colour, 0.8, view, order[::-1])
    np.testing.assert_allclose(one.coverage, other.coverage, atol=1e-12)
    assert np.abs(one.colour - other.colour).max() > 0.1


def shaded(points: np.ndarray, view: View):
    """Pieces that are darker farther away and have a colour of their strand."""
    pieces = hair_pieces(points, 8e-4, view)
    tint = np.random.default_rng(2).uniform(0.0, 1.0, (len(points), 3))
    strand_of = pieces.segment // (points.shape[1] - 1)
    near = (1.1 - pieces.depth.mean(1)) / 0.2
    return pieces, tint[strand_of] * np.clip(near, 0.1, 1.0)[:, None]


def test_more_bins_come_closer_to_sorting_every_pixel():
    points = waves(300, 65)
    view = camera()
    pieces, colour = shaded(points, view)
    exact = composite(pieces, colour, 0.7, view).colour
    found = []
    for bins in (1, 8, 64, 512):
        order = visibility_bins(points, view, bins).order
        found.append(psnr(composite(pieces, colour, 0.7, view, order).colour, exact))
    assert found[0] + 6.0 < found[1] and found[1] + 3.0 < found[2] < found[3]
    assert found[3] > 60.0


def test_more_segments_come_closer_to_sorting_every_pixel():
    # "Converges to exact ordering as hair strands are drawn with more segments."
    view = camera()
    fine = waves(300, 129)
    found = []
    for step in (16, 4, 1):
        points = fine[:, ::step]
        pieces, colour = shaded(points, view)
        exact = composite(pieces, colour, 0.7, view).colour
        order = visibility_bins(points, view, 4096).order
        found.append(psnr(composite(pieces, colour, 0.7, view, order).colour, exact))
    assert found[0] + 3.0 < found[1] and found[1] + 3.0 < found[2]


def test_a_wide_hair_covers_the_pixels_of_its_rectangle():
    # 2 pixels wide, from x = 2.25 to 4.25 and y = 1.5 to 6.
    points = strand([3.25, 1.5, 1.0], [3.25, 6.0, 1.0])
    view = flat_view()
    expected = np.zeros((8, 8))
    expected[1:6, 2:5] = [0.75, 1.0, 0.25]
    expected[1] *= 0.5
    pieces = hair_pieces(points, 0.02, view, 64)
    colour = np.tile(RED, (len(pieces.area), 1))
    for alpha in (1.0, 0.4):
        found = composite(pieces, colour, alpha, view)
        np.testing.assert_allclose(found.coverage, alpha * expected, atol=1e-12)
        np.testing.assert_allclose(found.colour[..., 0], found.coverage, atol=1e-12)
    # As few as it needs are within a strip of it.
    few = hair_pieces(points, 0.02, view, 4)
    found = composite(few, np.tile(RED, (len(few.area), 1)), 1.0, view)
    np.testing.assert_allclose(found.coverage, expected, atol=0.2501)


def test_a_picture_without_hair_is_empty():
    view = flat_view()
    beside = strand([20, 20, 1], [21, 21, 1])
    pieces = hair_pieces(beside, 0.01, view)
    found = composite(pieces, np.zeros((0, 3)), 1.0, view, np.array([0]))
    assert (found.coverage == 0.0).all() and (found.colour == 0.0).all()


@pytest.mark.parametrize("bins", [0, 1 << 17])
def test_numbers_of_bins_that_cannot_be_are_refused(bins):
    with pytest.raises(ValueError, match=f"1 to 65536 bins, got {bins}"):
        visibility_bins(across([1.0]), flat_view(), bins)
