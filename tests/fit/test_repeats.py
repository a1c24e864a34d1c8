import numpy as np
import pytest

from hairfit.capture.filters import gaussian_blur
from hairfit.capture.orientation import OrientationMap
from hairfit.fit.repeats import (
    AROUND,
    LAGS,
    Swings,
    correlation,
    find_pitch,
    find_swings,
    repeating_lines,
    repeats,
    shifted,
)

PIXEL = 0.003
SIZE = 120


def zigzag(pitch, way, hands, width=0.012):
    """Return a map of locks side by side, whose turns slope by 40 degrees.

    Each lock winds at a phase of its own, with one of the hands that are given.
    """
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:SIZE, :SIZE] * PIXEL
    along = np.cos(way) * x + np.sin(way) * y
    across = -np.sin(way) * x + np.cos(way) * y
    lock = np.floor(across / width).astype(int) - int(np.floor(across.min() / width))
    phase = rng.uniform(0.0, 2.0 * np.pi, lock.max() + 1)[lock]
    hand = rng.choice(hands, lock.max() + 1)[lock]
    turn = np.cos(2.0 * np.pi * along / pitch + phase)
    # The front of a turn shows for longer than its back.
    angle = way + np.radians(40.0) * np.where(turn > -0.3, hand, -hand)
    one = np.ones((SIZE, SIZE))
    return OrientationMap(np.mod(angle, np.pi), one, 0.1 * one)


def whole():
    return np.ones((SIZE, SIZE), bool)


def away(angle, way):
    return np.abs(np.mod(angle - way + np.pi / 2, np.pi) - np.pi / 2)


@pytest.mark.parametrize("pitch", [0.022, 0.033, 0.045])
def test_a_turn_is_as_long_as_what_repeats(pitch):
    found = zigzag(pitch, 1.2, (1.0, -1.0))
    assert find_pitch([repeats(whole(), found, PIXEL)]) == pytest.approx(
        pitch, rel=0.06
    )


@pytest.mark.parametrize("way", [0.3, 1.2, 2.4])
def test_locks_run_the_way_in_which_turns_repeat(way):
    found = zigzag(0.03, way, (1.0,))
    line = repeating_lines(whole(), found, PIXEL, 0.03)
    inner = (slice(20, -20), slice(20, -20))
    angle = np.arctan2(line[..., 1], line[..., 0])[inner] / 2.0
    assert np.median(away(angle, way)) < np.radians(5.0)
    # All wind to the right, and the mean of what one sees leans with them.
    twice = 2.0 * found.angle[inner]
    mean = np.arctan2(np.sin(twice).mean(), np.cos(twice).mean()) / 2.0
    assert away(mean, way) > np.radians(12.0)
    assert np.hypot(line[..., 0], line[..., 1]).max() <= 1.0 + 1e-6


def beside(swing):
    """Return a map of hair that runs down, whose waves go on from lock to lock.

    Along itself it repeats less, as its waves are not all as long.
    """
    rng = np.random.default_rng(0)
    x = np.arange(SIZE) * PIXEL
    turn = 2.0 * np.pi * x / 0.04 + rng.normal(0.0, 0.35, SIZE).cumsum()[:, None]
    one = np.ones((SIZE, SIZE))
    return OrientationMap(0.5 * np.pi + swing * np.cos(turn), one, 0.1 * one)


def test_hair_that_lies_alike_has_no_locks_across_it():
    def line(found):
        return repeating_lines(whole(), found, PIXEL, 0.04)[20:-20, 20:-20]

    # What swings far may run across what one sees in the mean, as steep curls do.
    assert np.median(line(beside(1.0))[..., 0]) > 0.5
    assert line(beside(0.2))[..., 0].max() < 0.0
    # And that it runs along the hair is no surer for that.
    sure = np.median(np.linalg.norm(line(beside(1.0)), axis=2))
    assert np.median(np.linalg.norm(line(beside(0.2)), axis=2)) <= sure


def test_what_is_alike_everywhere_or_nowhere_does_not_repeat():
    one = np.ones((SIZE, SIZE))
    even = OrientationMap(0.5 * one, one, 0.1 * one)
    assert find_pitch([repeats(whole(), even, PIXEL)]) is None
    rng = np.random.default_rng(0)
    noise = OrientationMap(rng.uniform(0.0, np.pi, one.shape), one, 0.1 * one)
    assert find_pitch([repeats(whole(), noise, PIXEL)]) is None


def test_no_hair_says_nothing():
    found = zigzag(0.03, 1.2, (1.0,))
    none = np.zeros((SIZE, SIZE), bool)
    assert not repeats(none, found, PIXEL).any()
    assert np.isfinite(repeating_lines(none, found, PIXEL, 0.03)).all()


def test_hair_is_all_that_counts():
    found = zigzag(0.03, 1.2, (1.0, -1.0))
    some = whole()
    some[:30], some[:, :41] = False, False
    rng = np.random.default_rng(1)
    angle = np.where(some, found.angle, rng.uniform(0.0, np.pi, found.angle.shape))
    other = OrientationMap(angle, found.confidence, found.sigma)
    assert np.array_equal(repeats(some, found, PIXEL), repeats(some, other, PIXEL))
    line = repeating_lines(some, found, PIXEL, 0.03)
    assert line.shape == (SIZE, SIZE, 2) and not line[:30].any()


def test_a_wave_goes_with_itself_as_its_cosine():
    y, x = np.mgrid[:300, :300] * PIXEL
    wave = np.cos(2.0 * np.pi * x / 0.03)
    line = np.stack([wave, np.zeros_like(wave)], axis=2).astype(np.float32)
    nothing = np.zeros_like(line)
    swings = Swings(line, nothing, PIXEL, 1, (slice(None), slice(None)))
    power = gaussian_blur((line**2).sum(axis=2), AROUND / PIXEL)
    middle = (slice(130, 170), slice(130, 170))
    for steps in (0, 3, 5, 10, 14):
        go = correlation(swings, 0.0, steps * PIXEL)[middle] / power[middle]
        expected = np.cos(2.0 * np.pi * steps * PIXEL / 0.03)
        assert go.mean() == pytest.approx(expected, abs=0.02)
        # Across the wave all is the same.
        across = correlation(swings, np.pi / 2, steps * PIXEL)[middle] / power[middle]
        assert across.mean() == pytest.approx(1.0, abs=0.02)


def test_the_pitch_is_at_the_first_peak_that_stands_out():
    fades = np.exp(-LAGS / 0.15)

    def waves(pitch):
        return fades * np.cos(2.0 * np.pi * LAGS / pitch)

    assert find_pitch([waves(0.0234)]) == pytest.approx(0.0234, rel=0.03)
    # Photographs count by how much they say.
    both = [waves(0.0234), 0.01 * waves(0.05)]
    assert find_pitch(both) == pytest.approx(0.0234, rel=0.03)
    assert find_pitch([fades]) is None
    assert find_pitch([waves(0.2)]) is None
    assert find_pitch([0.1 + 0.9 * fades + 0.05 * waves(0.02)]) is None
    assert find_pitch([np.zeros(len(LAGS))]) is None


def test_swings_are_what_is_left_of_the_mean():
    one = np.ones((SIZE, SIZE))
    even = OrientationMap(0.5 * one, one, 0.1 * one)
    assert np.abs(find_swings(whole(), even, PIXEL).line).max() < 1e-5
    swings = find_swings(whole(), even, PIXEL / 3)
    assert swings.times == 3 and swings.pixel == pytest.approx(PIXEL)


@pytest.mark.parametrize(
    "step", [(0, 0), (2, -3), (-4, 1), (9, 0), (0, -20), (-8, 2), (2, -11)]
)
def test_shifted_pixels_come_from_so_far_ahead(step):
    values = np.random.default_rng(0).normal(size=(6, 8, 2)).astype(np.float32)
    found = shifted(values, *step)
    for row, column in np.ndindex(6, 8):
        at = row + step[0], column + step[1]
        inside = 0 <= at[0] < 6 and 0 <= at[1] < 8
        expected = values[at] if inside else np.zeros(2, np.float32)
        assert np.array_equal(found[row, column], expected)
