import numpy as np
import pytest

from hairfit.capture.orientation import OrientationMap
from hairfit.fit.slopes import (
    BINS,
    EDGES,
    STEEP,
    SUREST,
    cross_locks,
    mean_cosine,
    slope_of,
    wave_slope_of,
)

SIZE = 50


def seen_of(slope, front):
    """Return how much of a picture shows a helix at each angle to its lock.

    Args:
        slope: Of the helix.
        front: Whether one sees the front half, or both through each other.
    """
    even = (np.arange(4000) + 0.5) / 4000
    along = np.sqrt(1.0 - even**2) if front else np.cos(0.5 * np.pi * even)
    return np.histogram(np.arctan(slope * along), EDGES)[0].astype(float)


@pytest.mark.parametrize("slope", [0.4, 1.0, 2.0])
def test_a_helix_gets_its_slope_back_from_its_fronts(slope):
    crossing = seen_of(slope, front=True)
    assert slope_of(crossing) == pytest.approx(slope, rel=0.02)


@pytest.mark.parametrize("slope", [0.4, 1.0, 2.0])
def test_backs_that_are_seen_change_it_little(slope):
    crossing = seen_of(slope, front=False)
    assert slope_of(crossing) == pytest.approx(slope, rel=0.06)


@pytest.mark.parametrize("slope", [0.4, 1.0, 2.0])
def test_the_mean_cosine_of_fronts_has_a_closed_form(slope):
    crossing = seen_of(slope, front=True)
    # The mean of (1 - w) / (1 + w) over u from 0 to 1, w = slope^2 (1 - u^2).
    true = 2.0 * np.arcsinh(slope) / (slope * np.hypot(1.0, slope)) - 1.0
    assert mean_cosine(crossing) == pytest.approx(true, abs=1e-3)


@pytest.mark.parametrize("slope", [0.2, 0.45, 1.0])
def test_waves_in_planes_that_are_seen_at_any_angle_get_their_slope_back(slope):
    even = np.pi * (np.arange(1000) + 0.5) / 1000
    across = slope * np.abs(np.cos(even)[:, None] * np.cos(even))
    crossing = np.histogram(np.arctan(across), EDGES)[0].astype(float)
    assert wave_slope_of(crossing) == pytest.approx(slope, rel=0.02)
    assert wave_slope_of(np.zeros(BINS)) == 0.0


@pytest.mark.parametrize("slope", [0.3, 0.6])
def test_waves_whose_slopes_are_seen_less_sharply_are_hardly_lower(slope):
    even = np.pi * (np.arange(300) + 0.5) / 300
    steep = np.abs(np.cos(even)[:, None] * np.cos(even))
    found = OrientationMap(np.arctan(slope * steep), 1.0 - 0.8 * steep, 0.1 * steep)
    sure = np.random.default_rng(0).uniform(0.1, 1.0, (*steep.shape, 1))
    lines = sure * np.array([1.0, 0.0])
    crossing = cross_locks(steep >= 0.0, found, lines)
    assert wave_slope_of(crossing) == pytest.approx(slope, rel=0.12)


def test_hair_that_crosses_at_a_right_angle_has_a_finite_slope():
    crossing = np.zeros(BINS)
    crossing[-1] = 1.0
    assert np.isfinite(slope_of(crossing)) and slope_of(crossing) > 50.0
    assert slope_of(np.zeros(BINS)) == 0.0 and mean_cosine(np.zeros(BINS)) == 1.0


@pytest.mark.parametrize("lock", [0.2, 1.5, 3.0])
def test_hair_crosses_either_way_alike(lock):
    rng = np.random.default_rng(0)
    off = np.where(rng.random((SIZE, SIZE)) < 0.5, 0.7, -0.7)
    one = np.ones((SIZE, SIZE))
    found = OrientationMap(np.mod(lock + off, np.pi), one, 0.1 * one)
    sure = rng.uniform(0.1, 1.0, (SIZE, SIZE, 1))
    lines = sure * np.array([np.cos(2.0 * lock), np.sin(2.0 * lock)])
    crossing = cross_locks(one > 0.0, found, lines)
    assert crossing.sum() == pytest.approx(SUREST * SIZE**2, rel=0.01)
    at = np.flatnonzero(crossing)
    assert np.all(np.abs(EDGES[at] - 0.7) < 2.0 * EDGES[1])
    steep = np.sqrt(1.0 - (1.0 - STEEP) ** 2)
    assert slope_of(crossing) == pytest.approx(np.tan(0.7) / steep, rel=0.03)


def test_what_locks_and_maps_are_not_sure_of_does_not_count():
    one = np.ones((SIZE, SIZE))
    rows = np.arange(SIZE)[:, None] * one
    # The surest locks run along the hair, of the others the map says nothing or lies.
    angle = np.where(rows < 20, 0.0, 1.2)
    confidence = np.where((rows >= 10) & (rows < 15), 0.0, 1.0)
    found = OrientationMap(angle, confidence, 0.1 * one)
    lines = np.stack([np.where(rows < 20, 0.9, 0.5), 0.0 * one], axis=2)
    crossing = cross_locks(one > 0.0, found, lines)
    assert crossing.sum() == 15 * SIZE and crossing[0] == crossing.sum()
    assert not cross_locks(one < 0.0, found, lines).any()
