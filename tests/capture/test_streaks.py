import numpy as np
import pytest

from hairfit.capture.streaks import COARSEST, FAR, find_streaks

PIXEL = 0.0006
SIDE = 360


def streaks_of(length, angle=0.4, pixel=PIXEL, side=SIDE, seed=0):
    """Return a picture of bright and dark strips 1.2 mm wide, and where they run.

    Args:
        length: Of each in metres, infinite for such that never end.
        angle: Which way they run, in radians.
        pixel: Width of a pixel, in metres.
        side: Pixels a side.
        seed: Of how bright they are and where they begin.
    """
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:side, :side] * pixel
    along = x * np.cos(angle) + y * np.sin(angle)
    row = np.floor((y * np.cos(angle) - x * np.sin(angle)) / 0.0012).astype(int)
    piece = np.zeros_like(row)
    if np.isfinite(length):
        piece = np.floor(along / length + rng.random(2000)[row % 2000]).astype(int)
    grey = rng.uniform(0.1, 0.6, (2000, 400))[row % 2000, piece % 400]
    return np.repeat(grey[..., None], 3, axis=2), np.full((side, side), angle)


def goes_on(image, angle, hair=None, pixel=PIXEL):
    """Return how alike far places are, against near ones, in the mean."""
    hair = np.ones(angle.shape, bool) if hair is None else hair
    found = find_streaks(image, hair, angle, pixel)
    assert found is not None
    return found.far.sum() / found.near.sum()


def test_streaks_go_on_as_far_as_they_are_long():
    endless, long, short = (
        goes_on(*streaks_of(length)) for length in (np.inf, 0.05, 0.010)
    )
    assert endless > 0.9
    # Of strips of one length, so many have both places: against those that have both
    # near ones.
    expected = (1.0 - FAR / 0.05) / (1.0 - 0.003 / 0.05)
    assert long == pytest.approx(expected, abs=0.1)
    assert abs(short) < 0.05


@pytest.mark.parametrize("length", [0.010, 0.05])
def test_finer_pictures_of_the_same_hair_tell_the_same(length):
    coarse = goes_on(*streaks_of(length))
    fine = goes_on(*streaks_of(length, pixel=PIXEL / 3, side=3 * SIDE), pixel=PIXEL / 3)
    assert fine == pytest.approx(coarse, abs=0.06)


def test_gaps_between_hairs_do_not_end_streaks():
    image, angle = streaks_of(np.inf)
    rng = np.random.default_rng(1)
    hair = rng.random(angle.shape) < 0.6
    whole, gaps = (
        find_streaks(image, one, angle, PIXEL) for one in (hair | True, hair)
    )
    assert whole is not None and gaps is not None
    assert gaps.count.mean() > 0.9 * whole.count.mean()
    assert gaps.far.sum() / gaps.near.sum() > 0.9


def test_streaks_are_followed_round_bends():
    side, middle = 360, np.array([-60.0, -60.0])
    y, x = np.mgrid[:side, :side] - middle[:, None, None]
    rng = np.random.default_rng(0)
    ring = (np.hypot(x, y) / 2.0).astype(int)
    grey = rng.uniform(0.1, 0.6, 1000)[ring]
    angle = np.arctan2(y, x) + 0.5 * np.pi
    # Lines have no sign: some point the other way.
    angle = np.where(rng.random(angle.shape) < 0.5, angle, angle + np.pi)
    assert goes_on(np.repeat(grey[..., None], 3, axis=2), angle) > 0.8


def test_what_is_no_hair_is_not_followed():
    image, angle = streaks_of(np.inf, angle=0.0)
    hair = np.zeros(angle.shape, bool)
    hair[:, 40:55] = True  # 9 mm along the streaks
    found = find_streaks(image, hair, angle, PIXEL)
    assert found is not None and not found.count.any() and not found.near.any()


def test_too_coarse_a_picture_tells_nothing():
    image, angle = streaks_of(np.inf)
    hair = np.ones(angle.shape, bool)
    assert find_streaks(image, hair, angle, 1.01 * COARSEST) is None
    assert find_streaks(image, hair, angle, 0.99 * COARSEST) is not None


def test_an_even_picture_is_alike_nowhere():
    angle = np.zeros((100, 100))
    found = find_streaks(np.full((100, 100, 3), 0.3), angle == 0, angle, PIXEL)
    assert found is not None and np.abs(found.near).max() < 1e-6
