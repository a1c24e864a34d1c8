import numpy as np
import pytest

from hairfit.capture.orientation import OrientationMap
from hairfit.fit.winding import leaning, means_along

PIXEL = 0.0005  # metres
PITCH = 0.04
LOCK = 20  # pixels across
SIZE = 320
ROWS, COLUMNS = np.indices((SIZE, SIZE))
HAIR = np.ones((SIZE, SIZE), bool)


def photograph(slope, *, winds, tilt=0.0):
    """Return the map of locks that hang, each at its own phase, and its lock lines.

    Of those that wind one sees the fronts, which slope to either side for a whole lock;
    those that wave slope to both.
    """
    rng = np.random.default_rng(0)
    lock = COLUMNS // LOCK
    phase = 2.0 * np.pi * rng.random(SIZE // LOCK)[lock]
    hand = np.where(rng.random(SIZE // LOCK) < 0.5, 1.0, -1.0)[lock]
    turned = np.cos(2.0 * np.pi * ROWS * PIXEL / PITCH + phase)
    across = slope * (hand * np.abs(turned) if winds else turned)
    angle = np.mod(0.5 * np.pi + tilt + np.arctan(across), np.pi)
    one = np.ones((SIZE, SIZE))
    lines = np.stack([-one, 0.0 * one], axis=2)  # straight down
    return OrientationMap(angle, one, 0.1 * one), lines


def share(found, lines, hair=HAIR):
    lean, whole = leaning(hair, found, lines, PIXEL, PITCH)
    return lean / whole


@pytest.mark.parametrize("slope", [0.4, 0.7, 1.1])
def test_locks_that_wind_lean_and_locks_that_wave_do_not(slope):
    assert share(*photograph(slope, winds=True)) > 0.4
    assert share(*photograph(slope, winds=False)) < 0.03


def test_that_all_locks_are_told_a_little_wrong_does_not_count():
    assert share(*photograph(0.5, winds=False, tilt=0.2)) < 0.03


def test_what_is_no_hair_or_says_nothing_does_not_count():
    found, lines = photograph(0.7, winds=True)
    half = COLUMNS < SIZE // 2
    whole = leaning(half, found, lines, PIXEL, PITCH)
    other = np.where(half, found.angle, 1.0)
    blind = np.where(half, found.confidence, 0.0)
    changed = OrientationMap(other, found.confidence, found.sigma)
    assert np.array_equal(leaning(half, changed, lines, PIXEL, PITCH), whole)
    changed = OrientationMap(other, blind, found.sigma)
    assert share(changed, lines) == pytest.approx(whole[0] / whole[1], rel=0.1)
    assert not leaning(~HAIR, found, lines, PIXEL, PITCH).any()
    mute = OrientationMap(found.angle, 0.0 * blind, found.sigma)
    assert not leaning(HAIR, mute, lines, PIXEL, PITCH).any()


@pytest.mark.parametrize("way", [0.0, 0.6, 2.1])
def test_a_mean_along_a_way_keeps_what_changes_across_it_alone(way):
    across = COLUMNS * np.sin(way) - ROWS * np.cos(way)
    along = COLUMNS * np.cos(way) + ROWS * np.sin(way)
    both = np.stack([across, np.cos(2.0 * np.pi * along / 30.0)], axis=2)
    angle = np.full((SIZE, SIZE), way, np.float32)
    found = means_along(both.astype(np.float32), angle, 30.0)
    inner = slice(20, -20), slice(20, -20)
    assert np.allclose(found[inner][..., 0], across[inner], atol=0.05)
    assert np.abs(found[inner][..., 1]).max() < 0.02
