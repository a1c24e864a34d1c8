import dataclasses

import numpy as np
import pytest
from ball_hair import camera_at, view_of

from hairfit.fit.cost import (
    QUALITIES,
    RATES,
    affordable,
    expected_cost,
    free_gigabytes,
    megapixels,
    refine_until,
)


@pytest.fixture
def views():
    camera = dataclasses.replace(camera_at([0.0, 0.0, 0.6]), width=1000, height=750)
    return [view_of(camera, np.ones((750, 1000), bool), f"{k:02}") for k in range(8)]


def test_costs_grow_with_the_area_of_the_photographs_and_with_quality(views):
    assert megapixels(views) == 6.0
    for quality in QUALITIES:
        none, four, eight = (expected_cost(views[:n], quality) for n in (0, 4, 8))
        assert 0 < none.seconds < four.seconds < eight.seconds
        assert np.isclose(eight.seconds - four.seconds, four.seconds - none.seconds)
        assert 0 < none.gigabytes < four.gigabytes < eight.gigabytes
    costs = [expected_cost(views, quality) for quality in QUALITIES]
    assert costs == sorted(costs)


def test_a_limit_allows_the_finest_quality_that_is_in_time(views):
    assert affordable(views, "high", None) == "high"
    assert affordable(views, "high", 1e4) == "high"
    assert affordable(views, "draft", 1e4) == "draft"
    assert affordable(views, "high", 1.0) == "draft"
    normal = expected_cost(views, "normal").seconds
    assert affordable(views, "high", 1.2 * normal) == "normal"
    assert affordable(views, "normal", 0.9 * normal) == "draft"


def test_the_refinement_stops_in_time_for_what_comes_after():
    assert refine_until("normal", None) is None
    for quality in QUALITIES:
        stop = refine_until(quality, 500.0)
        assert stop is not None
        assert 400.0 < stop < 500.0 - RATES[quality].after


def test_free_memory_is_some_gigabytes():
    free = free_gigabytes()
    assert free is None or 0.0 < free < 1e5
