import dataclasses

import numpy as np
import pytest
from ball_hair import camera_at, hull_where, view_of

from hairfit.capture.filters import mean_of_hair
from hairfit.fit.evidence import Planes
from hairfit.fit.shades import exposures, find_shades


@pytest.fixture
def places(rng):
    """What six photographs see of places: logarithms of brightness, and how well."""
    level = rng.normal(-3.0, 1.0, 400)
    seen = np.zeros((6, 400))
    for view in range(6):
        # Each sees a third of the ring, as its neighbours do.
        around = (np.arange(400) / 400 - view / 6 + 0.5) % 1.0 - 0.5
        seen[view] = np.clip(2.0 - 9.0 * np.abs(around), 0.0, 1.0)
    return np.tile(level, (6, 1)), seen


def test_exposures_of_a_ring_are_found(places, rng):
    levels, seen = places
    true = rng.normal(0.0, 0.5, 6)
    noise = rng.normal(0.0, 0.02, levels.shape)
    found = exposures(levels + true[:, None] + noise, seen)
    np.testing.assert_allclose(found, true - true.mean(), atol=0.02)


def test_a_tenth_of_the_places_that_hold_no_hair_hardly_matters(places):
    levels, seen = places
    levels[0, ::10] += 3.0
    assert np.abs(exposures(levels, seen)).max() < 0.06


def test_photographs_that_share_no_place_are_taken_as_they_are(rng):
    levels = rng.normal(-3.0, 1.0, (2, 100))
    seen = np.stack([np.arange(100) < 50, np.arange(100) >= 50]).astype(float)
    np.testing.assert_allclose(exposures(levels, seen), 0.0, atol=1e-9)


@pytest.fixture
def hull():
    return hull_where(
        lambda p: np.linalg.norm(p, axis=1) < 0.06, [-0.08] * 3, [0.08] * 3, 0.006
    )


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def view_with(grey, hair=None):
    camera = camera_at([0.0, 0.0, 0.6])
    shape = camera.height, camera.width
    hair = np.ones(shape, bool) if hair is None else hair
    image = np.broadcast_to(grey[..., None], (*shape, 3)).astype(np.float32)
    return dataclasses.replace(view_of(camera, hair), image=image)


def looking():
    """A photograph that sees nothing of what others see."""
    one = np.zeros(1, int)
    return Planes(np.zeros((1, 6)), np.zeros(1), np.zeros(1), (one, one))


def test_highlights_do_not_count(hull, rng):
    grey = np.exp(rng.normal(-3.0, 0.5, (128, 128)))
    bright = grey > np.quantile(grey, 0.7)
    shone = np.where(bright, grey * rng.uniform(1.0, 9.0, grey.shape), grey)
    plain, lit = (
        find_shades(hull, [view], [looking()])[0]
        for view in (view_with(grey), view_with(shone))
    )
    np.testing.assert_allclose(plain.level, lit.level, atol=1e-4)
    np.testing.assert_allclose(plain.contrast, lit.contrast, atol=1e-4)


def test_contrast_is_larger_beside_an_edge_of_a_shadow(hull):
    grey = np.full((128, 128), 0.2)
    grey[:, :50] = 0.02
    view = view_with(grey)
    shade = find_shades(hull, [view], [looking()])[0]
    assert shade.contrast[64, 50] > 5.0 * shade.contrast[64, 4]
    assert shade.contrast.min() > 0.0
    assert shade.level[64, 100] - shade.level[64, 10] == pytest.approx(
        np.log(10.0), abs=1e-3
    )


def test_black_hair_without_light_is_no_error(hull):
    view = view_with(np.zeros((128, 128)))
    shade = find_shades(hull, [view], [looking()])[0]
    assert np.isfinite(shade.level).all()
    assert np.isfinite(shade.contrast).all()


def test_means_of_hair_leave_out_what_is_beside_it(rng):
    hair = np.zeros((128, 128), bool)
    hair[:, 40:] = True
    values = np.where(hair, 2.0, -50.0).astype(np.float32)
    mean = mean_of_hair(values, hair, 3.0)
    np.testing.assert_allclose(mean[hair], 2.0, rtol=1e-5)
