import math

import cv2
import numpy as np
import pytest
from scipy import ndimage

from hairfit.capture.orientation import SIGMA_BLIND, estimate_orientation, line_angle
from hairfit.capture.shake import steady_orientation

SIZE = 360
BROWN = np.array([0.06, 0.035, 0.02])
HAIR = np.ones((SIZE, SIZE), bool)


def picture(lines, seed=0, glint=0.3):
    """Hair along angles, in locks of some pixels, that glints pixel by pixel."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    across = np.round(np.cos(lines) * y - np.sin(lines) * x).astype(int)
    place = rng.normal(size=4 * SIZE)
    locks = ndimage.gaussian_filter1d(place, 4.0)
    contrast = place[across] + 3.0 * (locks / locks.std())[across]
    contrast = 0.2 * contrast + glint * rng.normal(size=contrast.shape)
    return (BROWN * np.exp(contrast)[..., None]).astype(np.float32)


def shaken(image, pixels, angle):
    """Smear a picture along an angle."""
    steps = np.linspace(-0.5 * pixels, 0.5 * pixels, 40)
    moves = ((math.sin(angle) * s, math.cos(angle) * s, 0) for s in steps)
    moved = [ndimage.shift(image, move, order=1, mode="nearest") for move in moves]
    return np.mean(moved, axis=0).astype(np.float32)


def off(found, angle):
    return np.degrees(line_angle(found.angle, np.full(HAIR.shape, angle)))[
        20:-20, 20:-20
    ]


@pytest.mark.parametrize("degrees", [20.0, 110.0, 165.0])
@pytest.mark.parametrize("pixels", [5.0, 9.0])
def test_hair_of_a_shaken_photograph_runs_as_it_did(degrees, pixels):
    hair, smear = np.radians(degrees), np.radians(degrees + 70.0)
    image = shaken(picture(np.full(HAIR.shape, hair)), pixels, smear)
    # Filters follow the smear, and believe it.
    plain = estimate_orientation(image, HAIR)
    assert np.median(off(plain, hair)) > 40.0
    assert np.median(plain.confidence) > 0.2
    steady = steady_orientation(image, HAIR)
    assert np.median(off(steady.found, hair)) < 3.0
    assert steady.smear is not None and steady.smear.share > 0.5
    apart = line_angle(np.array([steady.smear.angle]), np.array([smear]))
    assert np.degrees(apart[0]) < 5.0


def test_the_map_of_a_sharp_photograph_stays_as_it_is():
    image = picture(np.full(HAIR.shape, 1.0))
    steady, plain = steady_orientation(image, HAIR), estimate_orientation(image, HAIR)
    assert steady.smear is None
    for name in ("angle", "confidence", "sigma"):
        np.testing.assert_array_equal(getattr(steady.found, name), getattr(plain, name))


def test_hair_that_runs_as_the_photograph_was_shaken_is_left():
    image = shaken(picture(np.full(HAIR.shape, 1.0)), 9.0, 1.0)
    steady = steady_orientation(image, HAIR)
    assert steady.smear is None and np.median(off(steady.found, 1.0)) < 1.0


def test_turns_of_curls_are_no_smear():
    # Locks hang; hair crosses them at 50 degrees, to either side in turn.
    y, _ = np.mgrid[:SIZE, :SIZE]
    side = np.where((y // 24) % 2, 1.0, -1.0)
    turn = 0.5 * np.pi + np.radians(50.0) * side
    image = picture(turn, glint=0.0)
    steady = steady_orientation(image, HAIR)
    assert steady.smear is None
    small = cv2.resize(image, (SIZE // 3, SIZE // 3), interpolation=cv2.INTER_AREA)
    coarse = estimate_orientation(small, HAIR[: SIZE // 3, : SIZE // 3])
    wide = np.kron(coarse.angle, np.ones((3, 3)))
    gap = line_angle(wide, steady.found.angle)
    assert (gap > np.radians(25.0)).mean() > 0.1  # the smaller picture sees other lines


def test_what_is_no_hair_says_nothing_in_a_shaken_photograph():
    y, x = np.mgrid[:SIZE, :SIZE]
    hair = np.hypot(x - 190, y - 170) < 150
    image = shaken(picture(np.full(HAIR.shape, 1.0)), 7.0, 2.2)
    found, smear = steady_orientation(image, hair)
    assert smear is not None
    assert (found.confidence[~hair] == 0.0).all()
    assert (found.sigma[~hair] == np.float32(SIGMA_BLIND)).all()
    assert (found.confidence[hair] > 0.0).mean() > 0.95
    assert ((found.angle >= 0) & (found.angle < np.pi)).all()


def test_little_hair_and_none_are_looked_at_as_they_are():
    hair = np.zeros_like(HAIR)
    image = shaken(picture(np.full(HAIR.shape, 1.0)), 7.0, 2.2)
    assert steady_orientation(image, hair).smear is None
    hair[100:220, 100:220] = True
    steady, plain = steady_orientation(image, hair), estimate_orientation(image, hair)
    assert steady.smear is None
    np.testing.assert_array_equal(steady.found.angle, plain.angle)
