import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hairfit.render.slices import (
    density_slices,
    gamma_slices,
    slab_of,
    uniform_slices,
)

depths = st.lists(st.floats(0.1, 5.0), min_size=2, max_size=60, unique=True)


@settings(max_examples=60, deadline=None)
@given(depths, st.integers(1, 20), st.floats(0.1, 4.0))
def test_all_schemes_rise_from_the_first_hair_to_the_last(depth, count, gamma):
    depth = np.array(depth)
    near, far = depth.min(), depth.max()
    for found in (
        uniform_slices(near, far, count),
        gamma_slices(near, far, count, gamma),
        density_slices(depth, count),
    ):
        assert len(found) == count + 1 and (np.diff(found) >= 0.0).all()
        assert np.isclose(found[0], near) and np.isclose(found[-1], far)


def test_gamma_slices_are_thinner_near_the_light():
    steps = np.diff(gamma_slices(1.0, 2.0, 8, 2.0))
    assert (np.diff(steps) > 0.0).all()
    assert np.allclose(gamma_slices(1.0, 2.0, 8, 1.0), uniform_slices(1.0, 2.0, 8))


def test_density_slices_share_the_hair_evenly():
    depth = np.random.default_rng(0).normal(2.0, 0.1, 10_000)
    found = density_slices(depth, 8, even=0.0)
    assert np.allclose(np.histogram(depth, found)[0], 1250, atol=1)
    flat = uniform_slices(found[0], found[-1], 8)
    assert np.allclose(density_slices(depth, 8, even=1.0), flat)
    thin = np.diff(density_slices(depth, 8))
    assert thin.argmin() in (3, 4) and thin.min() >= 0.2 * (found[-1] - found[0]) / 8


@settings(max_examples=60, deadline=None)
@given(depths, st.integers(1, 12))
def test_a_point_is_in_the_slab_that_a_plain_search_finds(depth, count):
    slices = uniform_slices(1.0, 3.0, count)
    for d, slab in zip(depth, slab_of(np.array(depth), slices), strict=True):
        inside = [i for i in range(count) if slices[i] <= d < slices[i + 1]]
        ends = 0 if d < 1.0 else count - 1
        assert slab == (inside[0] if inside else ends)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: uniform_slices(1.0, 2.0, 0), "at least 1 map"),
        (lambda: uniform_slices(1.0, 1.0, 4), "a range of depths"),
        (lambda: gamma_slices(1.0, 2.0, 4, 0.0), "gamma must be positive"),
        (lambda: density_slices(np.array([]), 4), "more than one point"),
        (
            lambda: density_slices(np.array([1.0, 2.0]), 4, even=2.0),
            "share from 0 to 1",
        ),
    ],
)
def test_what_makes_no_slabs_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()
