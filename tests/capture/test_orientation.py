import numpy as np
import pytest

from hairfit.capture import orientation
from hairfit.capture.orientation import (
    SIGMA_BLIND,
    OrientationConfig,
    angle_of_line,
    estimate_orientation,
    expected_error,
    line_angle,
)
from hairfit.errors import InputError
from hairfit.render.raster import mesh_depth, rasterise

BROWN = np.array([0.06, 0.035, 0.02])
SIZE = 96
EVERYWHERE = np.ones((SIZE, SIZE), bool)


def strands(theta, seed=0, size=SIZE, width=2.0):
    """Contrast of straight lines along theta, of any width, as strands have it."""
    y, x = np.mgrid[:size, :size] + 0.5
    across = -np.sin(theta) * x + np.cos(theta) * y
    rng = np.random.default_rng(seed)
    place = np.arange(-2 * size, 2 * size, 1.0)
    height = rng.normal(size=len(place))
    bump = np.exp(-0.5 * ((across[..., None] - place) / (0.5 * width)) ** 2)
    lines = bump @ height
    return lines / lines.std()


def picture(contrast, noise=0.05, seed=1):
    rng = np.random.default_rng(seed)
    image = BROWN * np.exp(0.3 * contrast)[..., None]
    return (image * (1 + noise * rng.normal(size=image.shape))).astype(np.float32)


def apart(angle, theta):
    away = np.abs(angle - theta) % np.pi
    return np.degrees(np.minimum(away, np.pi - away))


@pytest.mark.parametrize("degrees", [0.0, 0.4, 17.0, 45.0, 90.0, 118.0, 179.7])
def test_lines_come_back_at_their_angle(degrees):
    theta = np.radians(degrees)
    found = estimate_orientation(picture(strands(theta)), EVERYWHERE)
    off = apart(found.angle, theta)
    # At the picture's border lines end, which bends what the filters see.
    assert np.quantile(off[12:-12, 12:-12], 0.95) < 1.2
    assert np.median(off) < 0.5 and np.quantile(off, 0.95) < 3.0
    assert (found.angle >= 0).all() and (found.angle < np.pi).all()
    assert np.median(found.confidence) > 0.5


def test_a_quarter_turn_of_the_picture_turns_the_map():
    image = picture(strands(0.3), noise=0.3)
    y, x = np.mgrid[:SIZE, :SIZE]
    hair = (x - 40) ** 2 + (y - 52) ** 2 < 38**2
    found = estimate_orientation(image, hair)
    turned = estimate_orientation(
        np.ascontiguousarray(np.rot90(image)), np.ascontiguousarray(np.rot90(hair))
    )
    here = np.rot90(hair)
    assert apart(turned.angle, np.rot90(found.angle) + np.pi / 2)[here].max() < 0.1
    np.testing.assert_allclose(turned.sigma, np.rot90(found.sigma), rtol=0.02)


def test_a_mirrored_picture_mirrors_the_angle():
    image = picture(strands(1.0), noise=0.3)
    found = estimate_orientation(image, EVERYWHERE)
    mirrored = estimate_orientation(np.ascontiguousarray(image[:, ::-1]), EVERYWHERE)
    assert apart(mirrored.angle, np.pi - found.angle[:, ::-1]).max() < 0.5


def test_exposure_changes_nothing():
    image = picture(strands(0.8), noise=0.3)
    bright = estimate_orientation(8 * image, EVERYWHERE)
    dark = estimate_orientation(0.5 * image, EVERYWHERE)
    assert apart(bright.angle, dark.angle).max() < 0.1
    np.testing.assert_allclose(bright.sigma, dark.sigma, rtol=1e-2)


def test_strands_in_shadow_count_as_those_in_light():
    contrast = strands(0.5)
    shade = np.where(np.arange(SIZE) < SIZE // 2, 1.0, 0.1)[None, :, None]
    image = (picture(contrast) * shade).astype(np.float32)
    found = estimate_orientation(image, EVERYWHERE)
    dark = found.angle[12:-12, SIZE // 2 + 20 : -8]
    assert np.quantile(apart(dark, 0.5), 0.95) < 2.0


def test_noise_is_not_trusted():
    found = estimate_orientation(picture(np.zeros((SIZE, SIZE)), 0.3), EVERYWHERE)
    assert np.median(found.sigma) > np.radians(30)
    assert found.confidence.max() < 0.1


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.1])
def test_the_silhouette_of_something_flat_is_not_trusted(noise):
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    share = np.clip(40.5 - np.hypot(y - 48, x - 48), 0, 1)  # of hair in a mixed pixel
    image = share[..., None] * BROWN + (1 - share)[..., None] * 0.4
    image = image * (1 + noise * np.random.default_rng(0).normal(size=image.shape))
    found = estimate_orientation(image.astype(np.float32), share > 0.5)
    assert found.confidence.max() < 0.2
    assert found.confidence.mean() < 0.03


def test_what_is_outside_the_mask_does_not_matter():
    y, x = np.mgrid[:SIZE, :SIZE]
    hair = (x - 48) ** 2 + (y - 48) ** 2 < 40**2
    image = picture(strands(0.7))
    stripes = picture(strands(2.2, seed=5), seed=7)
    alone = estimate_orientation(image, hair)
    beside = estimate_orientation(np.where(hair[..., None], image, stripes), hair)
    np.testing.assert_array_equal(alone.angle, beside.angle)
    np.testing.assert_array_equal(alone.sigma, beside.sigma)
    assert (beside.confidence[~hair] == 0).all()
    assert (beside.angle[~hair] == 0).all()


def test_crossing_hair_is_trusted_less():
    one, other = strands(0.4), strands(0.4 + np.pi / 2, seed=3)
    single = estimate_orientation(picture(one), EVERYWHERE)
    crossed = estimate_orientation(picture((one + other) / np.sqrt(2)), EVERYWHERE)
    assert np.median(crossed.confidence) < 0.25 * np.median(single.confidence)


@pytest.mark.parametrize("noise", [0.3, 1.0])
def test_the_expected_error_bounds_that_of_noisy_straight_lines(noise):
    # Straight parallel lines are the easiest hair: they err less than hair so coherent.
    image = picture(strands(1.1), noise).clip(1e-3)
    found = estimate_orientation(image, EVERYWHERE)
    actual = 1.4826 * np.median(apart(found.angle, 1.1))
    expected = np.degrees(np.median(found.sigma))
    assert expected / 8 < actual < 1.5 * expected


def wavy(noise, length=32.0):
    """Hair that hangs down in waves of a length, in pixels, and its direction."""
    y, x = np.mgrid[:SIZE, :SIZE] + 0.5
    turn = 2 * np.pi * y / length
    shift = 5.0 / 32 * length * np.sin(turn)
    slope = 5.0 / 32 * 2 * np.pi * np.cos(turn)
    place = np.arange(-40, SIZE + 40, 1.0)
    height = np.random.default_rng(2).normal(size=len(place))
    lines = np.exp(-0.5 * ((x - shift)[..., None] - place) ** 2) @ height
    return picture(lines / lines.std(), noise), np.arctan2(1.0, slope) % np.pi


def test_waves_are_followed_and_their_error_is_expected():
    image, theta = wavy(0.1)
    found = estimate_orientation(image, EVERYWHERE)
    off = apart(found.angle, theta)
    straight = apart(np.pi / 2, theta)
    assert np.median(off) < 0.4 * np.median(straight)
    ratio = 1.4826 * np.median(off) / np.degrees(np.median(found.sigma))
    assert 0.5 < ratio < 2.0


def test_waves_are_followed_better_than_by_one_wide_mean():
    image, theta = wavy(0.1)
    adaptive = estimate_orientation(image, EVERYWHERE)
    wide = OrientationConfig(pooling=(11.9, 12.0))
    fixed = estimate_orientation(image, EVERYWHERE, config=wide)
    off = [np.median(apart(found.angle, theta)) for found in (adaptive, fixed)]
    assert off[0] < 0.5 * off[1]


def errors_of_both_sizes(monkeypatch, image, theta):
    """The median error with filters of half the size, and that without them."""
    both = estimate_orientation(image, EVERYWHERE)
    monkeypatch.setattr(orientation, "LARGEST", SIZE - 1)
    whole = estimate_orientation(image, EVERYWHERE)
    return [np.median(apart(found.angle, theta)) for found in (both, whole)]


@pytest.mark.parametrize("length", [32.0, 44.0])
def test_filters_of_half_the_size_follow_short_waves(monkeypatch, length):
    image, theta = wavy(0.1, length)
    off = errors_of_both_sizes(monkeypatch, image, theta)
    assert off[0] < 0.65 * off[1]


@pytest.mark.parametrize("noise", [0.1, 0.3, 1.0])
def test_filters_of_half_the_size_cost_straight_hair_nothing(monkeypatch, noise):
    image = picture(strands(1.1), noise).clip(1e-3)
    off = errors_of_both_sizes(monkeypatch, image, 1.1)
    assert off[0] < 1.05 * off[1] + 0.1


def test_expected_error_falls_with_coherence_and_grows_with_bend():
    coherence = np.linspace(0.01, 1.0, 50)
    error = expected_error(coherence, np.zeros(50))
    assert (np.diff(error) <= 0).all() and error[0] == SIGMA_BLIND
    assert (expected_error(coherence[20:], np.full(30, 0.1)) > error[20:]).all()


@pytest.mark.parametrize("image", ["black", "flat", "sparks", "negative"])
def test_odd_pictures_give_numbers_and_no_trust(image):
    value = np.zeros((SIZE - 1, SIZE - 5, 3), np.float32)
    if image == "flat":
        value += 0.5
    elif image == "sparks":
        value[np.random.default_rng(0).random(value.shape[:2]) < 0.01] = 1e4
    elif image == "negative":
        value -= 1.0
    hair = np.ones(value.shape[:2], bool)
    hair[:3] = False
    found = estimate_orientation(value, hair)
    for part in (found.angle, found.confidence, found.sigma):
        assert np.isfinite(part).all() and part.shape == hair.shape
    assert image == "sparks" or found.confidence.max() < 0.1


@pytest.mark.parametrize("pixels", [0, 1, 7])
def test_masks_with_next_to_nothing_are_handled(pixels):
    hair = np.zeros((SIZE, SIZE), bool)
    hair[20, 30 : 30 + pixels] = True
    found = estimate_orientation(picture(strands(0.3)), hair)
    assert np.isfinite(found.angle).all() and np.isfinite(found.sigma).all()
    assert (found.confidence[~hair] == 0).all()


def test_same_picture_same_bytes():
    image = picture(strands(0.3), noise=0.5)
    one, two = (estimate_orientation(image, EVERYWHERE) for _ in range(2))
    assert one.angle.tobytes() == two.angle.tobytes()
    assert one.sigma.tobytes() == two.sigma.tobytes()


def test_float64_pictures_are_taken():
    image = picture(strands(0.3))
    single = estimate_orientation(image, EVERYWHERE)
    double = estimate_orientation(image.astype(np.float64), EVERYWHERE)
    assert apart(single.angle, double.angle).max() < 0.1


def test_a_mask_of_another_size_is_refused():
    message = r"shape \(96, 96, 3\) and its hair mask \(95, 96\)"
    with pytest.raises(InputError, match=message):
        estimate_orientation(picture(strands(0.3)), EVERYWHERE[1:])
    with pytest.raises(InputError, match="a picture with three channels"):
        estimate_orientation(picture(strands(0.3))[..., 0], EVERYWHERE)


def test_a_picture_with_holes_is_refused():
    image = picture(strands(0.3))
    image[3, 4, 1] = np.nan
    with pytest.raises(InputError, match="not finite"):
        estimate_orientation(image, EVERYWHERE)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "bound"), [("ruby", 6.0), ("ponytail", 6.0)])
def test_photographs_come_back_within_bounds(captures, name, bound):
    from hairfit.capture import load_capture

    capture = load_capture(captures / name, "02,05")
    with np.load(captures / name / "truth.npz") as file:
        points = file["points"].reshape(len(file["offsets"]) - 1, -1, 3)
    for view in capture.views:
        assert capture.head is not None
        hidden = mesh_depth(capture.head, view.camera) + 2e-3
        truth = rasterise(points.astype(np.float64), view.camera, mesh_depth=hidden)
        found = estimate_orientation(view.image, view.hair)
        both = view.hair & truth.coverage
        off = apart(found.angle, truth.orientation)[both]
        order = np.argsort(off)
        total = np.cumsum(found.confidence[both][order])
        assert off[order][np.searchsorted(total, 0.5 * total[-1])] < bound
        ratio = 1.4826 * np.median(off) / np.degrees(np.median(found.sigma[both]))
        assert 0.6 < ratio < 1.6


def test_angles_of_lines_are_below_a_half_turn():
    angle = np.array([0.0, 0.4, 1.6, 3.1, -0.4])
    found = angle_of_line(3.0 * np.cos(2.0 * angle), 3.0 * np.sin(2.0 * angle))
    assert np.allclose(found, np.mod(angle, np.pi), atol=1e-6)
    # Its half is a tiny angle below 0: pi itself, if it were rounded.
    assert angle_of_line(np.ones(1), np.array([-1e-12]))[0] == 0.0


def test_lines_have_no_sign():
    first = np.array([0.0, 0.1, 3.1, 1.0])
    second = np.array([0.0, 3.1, 0.1, 1.0 + np.pi / 2])
    apart = np.pi - 3.0
    expected = [0.0, apart, apart, np.pi / 2]
    assert np.allclose(line_angle(first, second), expected)
