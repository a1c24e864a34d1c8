import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import camera_at, hull_where, photograph, view_of
from scipy import ndimage

from hairfit.capture import load_capture
from hairfit.capture.orientation import OrientationMap, estimate_orientation
from hairfit.evaluate.curls import find_curls, median_of
from hairfit.fit.curls import (
    FRIZZY,
    SURE,
    UNSEEN,
    is_frizzy,
    mean_confidence,
    own_swing,
    points_for,
    see_curls,
    see_locks,
    wave_height,
)
from hairfit.fit.hull import pixel_sizes
from hairfit.io.strands import load_strands
from hairfit.model.fur import curl_strands
from hairfit.model.locks import PITCH
from hairfit.model.tree import leaves
from hairfit.synthetic.gallery import make_gallery_tree, make_subject
from hairfit.synthetic.head import make_head, make_scalp
from hairfit.synthetic.scene import Scene, write_capture
from hairfit.synthetic.styles import make_style
from hairfit.types import along_paths

FRONT = camera_at([0.0, 0.0, 0.4], finer=4)
PIXEL = 0.4 / 640  # metres: 0.4 m before the lens, of 640 pixels' focal length
HULL = hull_where(lambda p: np.abs(p[:, 2]) < 0.01, [-0.1] * 3, [0.1] * 3, 0.01)


def curtain(radius=0.0, pitch=0.03, bend=0.0):
    """Return locks of hairs that hang side by side, each lock at its own phase."""
    rng = np.random.default_rng(0)
    locks = round(0.18 / (2.2 * radius)) if radius else 50
    hairs = 1000 // locks
    x = np.repeat(np.linspace(-0.09, 0.09, locks), hairs)
    x = x + rng.normal(0.0, 0.001, len(x))
    y = np.linspace(0.1, -0.1, 160)
    x = x[:, None] + bend * np.sin(np.pi * y / 0.2)
    strands = np.stack(np.broadcast_arrays(x, y, 0.0), axis=-1)
    if not radius:
        return strands
    phase = np.repeat(rng.uniform(0.0, 2.0 * np.pi, locks), hairs)
    how = (np.full(len(x), radius), np.full(len(x), pitch), phase)
    return np.asarray(curl_strands(jnp.asarray(strands), *map(jnp.asarray, how)))


def seen(strands):
    found = photograph(strands, [FRONT], None)
    return found.views, found.maps


def radius_of(views, maps, hull=HULL):
    return see_curls(hull, views, maps).radius


@pytest.mark.parametrize(
    ("radius", "pitch"),
    [(0.0035, 0.021), (0.005, 0.03), (0.006, 0.036), (0.004, 0.034), (0.006, 0.022)],
)
def test_the_radius_and_pitch_of_curls_are_found(radius, pitch):
    views, maps = seen(curtain(radius, pitch))
    found = see_curls(HULL, views, maps)
    assert found.radius == pytest.approx(radius, rel=0.1)
    assert found.pitch == pytest.approx(pitch, rel=0.05)


def test_hair_that_does_not_curl_has_no_radius():
    assert radius_of(*seen(curtain())) == 0.0
    assert radius_of(*seen(curtain(bend=0.03))) == 0.0
    # Waves are no curls: 14 degrees from their lock.
    assert radius_of(*seen(curtain(0.0018, 0.045))) == 0.0


@pytest.mark.parametrize(("radius", "length"), [(0.0018, 0.045), (0.0026, 0.065)])
def test_hair_that_waves_tells_how_long_a_wave_is(radius, length):
    views, maps = seen(curtain(radius, length))
    found = see_curls(HULL, views, maps)
    assert found.radius == 0.0 and found.wave == pytest.approx(length, rel=0.05)
    assert found.maps[0] is maps[0]


def waving(height, length):
    """Return locks of hairs that hang, each lock waving in a plane of its own."""
    strands = curtain(0.003, 0.03)
    rng = np.random.default_rng(1)
    lock = np.unique(
        np.round(strands[:, :, 0].mean(axis=1) / 0.0066), return_inverse=True
    )[1]
    turn, phase = 2.0 * np.pi * rng.random((2, lock.max() + 1))
    x, y = strands[:, :, 0].mean(axis=1)[:, None], strands[:, :, 1]
    off = height * np.cos(2.0 * np.pi / length * y + phase[lock][:, None])
    across, deep = np.cos(turn[lock])[:, None], np.sin(turn[lock])[:, None]
    return np.stack([x + across * off, y, deep * off], axis=-1)


@pytest.mark.parametrize(("height", "length"), [(0.0026, 0.045), (0.004, 0.06)])
def test_hair_that_waves_tells_how_high_its_waves_are(height, length):
    found = see_curls(HULL, *seen(waving(height, length)))
    assert found.wave == pytest.approx(length, rel=0.05)
    assert found.height == pytest.approx(height, rel=0.08)


def test_hair_that_repeats_by_chance_has_no_waves():
    views, maps = seen(curtain(bend=0.03))
    hair, pixels = [view.hair for view in views], [PIXEL] * len(views)
    rng = np.random.default_rng(0)
    angle = rng.uniform(0.0, np.pi, maps[0].angle.shape).astype(np.float32)
    chance = [dataclasses.replace(maps[0], angle=angle)]
    locks = see_locks(hair, chance, pixels, 0.05)
    assert wave_height(locks.crossing, 0.05) == 0.0


def hanging(found, *, winds):
    """Return the map of locks that hang and swing, surest where they run straight down.

    Those that wind slope to one side each, those that wave to both.
    """
    rng = np.random.default_rng(0)
    rows, columns = np.indices(found.angle.shape)
    lock = columns // round(0.01 / PIXEL)
    phase, hand = 2.0 * np.pi * rng.random((2, lock.max() + 1))
    turned = np.cos(2.0 * np.pi * rows * PIXEL / 0.045 + phase[lock])
    one_side = np.where(hand < np.pi, 0.5, -0.5)[lock] * (1.0 + turned)
    across = 0.6 * (one_side if winds else 0.5 * turned)
    angle = np.mod(0.5 * np.pi + np.arctan(across), np.pi)
    sure = found.confidence * np.exp(-5.0 * across**2)
    return dataclasses.replace(
        found, angle=angle.astype(np.float32), confidence=sure.astype(np.float32)
    )


def test_hair_that_winds_curls_however_little_it_swings():
    views, maps = seen(curtain())
    flat = see_curls(HULL, views, [hanging(one, winds=False) for one in maps])
    assert flat.radius == 0.0 and flat.wave == pytest.approx(0.045, rel=0.05)
    wound = see_curls(HULL, views, [hanging(one, winds=True) for one in maps])
    assert wound.radius > 0.002 and wound.pitch == pytest.approx(0.045, rel=0.05)


def test_waves_that_go_on_from_lock_to_lock_are_no_curls_across_them():
    views, maps = seen(curtain())
    y, x = np.indices(maps[0].angle.shape) * PIXEL
    drifts = np.random.default_rng(0).normal(0.0, 7.5 * PIXEL**0.5, 2000).cumsum()
    # They are alike at 40 degrees from one lock to the next, and hair runs down.
    way = np.radians(40.0)
    beside = x * np.cos(way) + y * np.sin(way)
    along = 0.4 + y * np.cos(way) - x * np.sin(way)
    turn = 2.0 * np.pi * beside / 0.04 + drifts[np.rint(along / PIXEL).astype(int)]
    angle = (0.5 * np.pi + 0.2 * np.cos(turn)).astype(np.float32)
    found = see_curls(HULL, views, [dataclasses.replace(maps[0], angle=angle)])
    assert found.radius == 0.0 and found.told


def test_neither_curls_nor_a_bend_are_waves():
    assert see_curls(HULL, *seen(curtain(0.005, 0.03))).wave == 0.0
    assert see_curls(HULL, *seen(curtain(bend=0.03))).wave == 0.0


def test_straight_hair_is_taken_as_it_looks():
    views, maps = seen(curtain())
    found = see_curls(HULL, views, maps)
    assert found.wave == 0.0
    assert found.told and all(a is b for a, b in zip(found.maps, maps, strict=True))


def test_angles_that_repeat_nowhere_are_no_curls():
    views, maps = seen(curtain())
    angle = np.random.default_rng(1).uniform(0.0, np.pi, maps[0].angle.shape)
    assert radius_of(views, [dataclasses.replace(maps[0], angle=angle)]) == 0.0


def test_where_nothing_shows_hair_curls_at_no_known_pitch():
    hair = np.zeros((FRONT.height, FRONT.width), bool)
    zero = np.zeros(hair.shape)
    blind = OrientationMap(zero, zero, zero)
    found = see_curls(HULL, [view_of(FRONT, hair)], [blind])
    assert found.radius == UNSEEN and not found.told
    assert found.pitch == PITCH * UNSEEN


def test_locks_run_down_where_their_curls_do_not():
    views, maps = seen(curtain(0.005, 0.03))
    hair = views[0].hair
    lock = see_locks([hair], maps, [PIXEL], 0.03).maps[0]

    def away(found):
        """Return how far from upright lines are."""
        return np.abs(np.abs(found.angle[hair]) - 0.5 * np.pi)

    assert np.median(away(maps[0])) > np.radians(25)
    assert np.median(away(lock)) < np.radians(10)
    # The error that it expects is the lock's, not what curls swing about it.
    expected = np.median(lock.sigma[hair])
    assert 1.4826 * np.median(away(lock)) < expected < 0.5 * np.median(away(maps[0]))
    assert not lock.confidence[~hair].any()


def test_straight_hair_is_its_own_lock():
    views, maps = seen(curtain())
    hair = views[0].hair
    lock = see_locks([hair], maps, [PIXEL], 0.03).maps[0]
    turn = np.sin(lock.angle - maps[0].angle)[hair]
    assert np.percentile(np.abs(turn), 95) < np.radians(3)
    assert np.median(lock.confidence[hair]) > 0.99


def test_a_pixel_is_as_wide_as_its_camera_makes_it():
    hair = np.ones((FRONT.height, FRONT.width), bool)
    assert pixel_sizes(HULL, [view_of(FRONT, hair)]) == [pytest.approx(PIXEL)]


def test_strands_get_points_for_every_turn():
    tree = make_style("straight", 0, make_scalp(make_head()))
    length = along_paths(np.asarray(tree.cylinder.skeleton)[leaves(tree)])[:, -1]
    assert points_for(tree, 0.0, 40) == 40
    points = points_for(tree, 0.03, 40)
    assert points % 40 == 0
    assert points >= 8 * np.median(length) / 0.03 > points - 60
    assert points_for(tree, 0.3, 40) == 40
    assert points_for(tree, 6e-4, 40) == 160


@pytest.mark.slow
def test_curls_of_drawn_photographs_are_found(tmp_path):
    head = make_head()
    scene = Scene(4, (576, 768), strands=4000, points=64)
    tree = make_style("curly", 0, make_scalp(head))
    write_capture(tree, head, tmp_path / "curly", scene)
    views = load_capture(tmp_path / "curly").views
    maps = [estimate_orientation(view.image, view.hair) for view in views]
    hull = hull_where(
        lambda p: np.linalg.norm(p, axis=1) < 0.1, [-0.1] * 3, [0.1] * 3, 0.01
    )
    found = see_curls(hull, views, maps)
    true = find_curls(load_strands(tmp_path / "curly" / "truth.npz"))
    assert found.pitch == pytest.approx(median_of(true.pitch, true.curled), rel=0.1)
    assert found.radius == pytest.approx(median_of(true.radius, true.curled), rel=0.1)


def photographed(grey):
    """Return a photograph that is all hair, and its map."""
    hair = np.ones(grey.shape, bool)
    camera = dataclasses.replace(FRONT, width=grey.shape[1], height=grey.shape[0])
    image = np.repeat(np.clip(grey, 0.0, 1.0)[..., None], 3, axis=2)
    view = dataclasses.replace(view_of(camera, hair), image=image)
    return [view], [estimate_orientation(image, hair)]


def stripes(noise):
    """Return stripes that run down, with grain."""
    x = np.arange(256)
    clean = np.tile(0.3 + 0.1 * np.sin(2 * np.pi * x / 12), (256, 1))
    return clean + noise * np.random.default_rng(0).normal(size=clean.shape)


def frizz(bend=2.5, lean=None):
    """Return short bright arcs that cross each other, at all angles or about down.

    Args:
        bend: How far each goes round, in radians.
        lean: Standard deviation of their angles from down, None for all angles.
    """
    rng = np.random.default_rng(0)
    grey = np.full((512, 512), 0.2)
    for _ in range(24000):
        at, angle = rng.uniform(0, 512, 2), rng.uniform(0.0, 2.0 * np.pi)
        if lean is not None:
            angle = rng.normal(-0.5 * bend, lean)
        turn = angle + np.linspace(0.0, bend, 24)
        x, y = (at[:, None] + 5.0 * np.array([np.cos(turn), np.sin(turn)])) % 512
        grey[y.astype(int), x.astype(int)] = rng.uniform(0.1, 0.6)
    return grey


def test_noise_is_told_from_hair_that_shows_no_direction():
    views, maps = photographed(stripes(0.4))
    assert mean_confidence(views, maps) < SURE
    assert see_curls(HULL, views, maps).told
    views, maps = photographed(frizz())
    assert mean_confidence(views, maps) < SURE
    found = see_curls(HULL, views, maps)
    assert found.radius == UNSEEN and not found.told
    assert not any(m.confidence.any() for m in found.maps)


def test_locks_that_show_through_frizz_tell_which_way_it_runs():
    arcs = frizz(2.0, 0.5)
    assert not see_curls(HULL, *photographed(arcs)).told
    views, maps = photographed(arcs + 1.8 * (unsteady(5.0, 40) - 0.3))
    found = see_curls(HULL, views, maps)
    assert found.radius == UNSEEN and found.told and found.maps == maps
    # Locks that run straight on through it are of hair that does not curl.
    views, maps = photographed(arcs + 1.2 * (unsteady(0.0, 40) - 0.3))
    assert mean_confidence(views, maps) < SURE
    found = see_curls(HULL, views, maps)
    assert found.radius == 0.0 and found.told and found.maps == maps


def unsteady(far, wide=14):
    """Return stripes that run down and waver by so many pixels, here and there.

    Each is so many pixels wide.
    """
    rng = np.random.default_rng(0)
    off = ndimage.gaussian_filter(rng.normal(size=(512, 512)), (8.0, 24.0))
    x = np.arange(512) + far * off / off.std()
    return 0.3 + 0.1 * np.sin(2.0 * np.pi * x / wide)


def locks(wide):
    """Return stripes that lean to one side in each square lock, to the other beside."""
    y, x = np.mgrid[:512, :512]
    lean = np.radians(np.where((y // wide + x // wide) % 2, 30.0, -30.0))
    return 0.3 + 0.1 * np.sin(2.0 * np.pi * (x * np.cos(lean) + y * np.sin(lean)) / 14)


def test_hair_that_swings_from_lock_to_lock_only_does_not_curl():
    for wide, expected in ((96, False), (24, True)):
        views, maps = photographed(locks(wide))
        pixels = pixel_sizes(HULL, views)
        assert own_swing(views, maps, pixels) > FRIZZY
        assert is_frizzy(views, maps, pixels) == expected


def test_hair_that_swings_and_repeats_nowhere_curls_finely():
    views, maps = photographed(unsteady(1.0))
    steady = see_curls(HULL, views, maps)
    assert steady.radius == 0.0 and steady.told
    views, maps = photographed(unsteady(6.0))
    assert mean_confidence(views, maps) > SURE
    found = see_curls(HULL, views, maps)
    assert found.radius == UNSEEN and found.told and found.maps == maps


@pytest.mark.slow
@pytest.mark.parametrize(("style", "told"), [("afro", False), ("buzz-cut", True)])
def test_an_afro_is_told_from_short_hair_by_one_photograph(tmp_path, style, told):
    subject = make_subject()
    scene = Scene(1, (600, 800), strands=12000, points=64)
    tree = make_gallery_tree(style, 0, subject)
    write_capture(tree, subject.head, tmp_path / style, scene)
    view = load_capture(tmp_path / style).views[0]
    grain = np.random.default_rng(0).normal(size=view.image.shape)
    for noise in (0.0, 0.03):
        image = np.clip(view.image + noise * grain, 0.0, 1.0).astype(np.float32)
        maps = [estimate_orientation(image, view.hair)]
        taken = dataclasses.replace(view, image=image)
        assert see_curls(HULL, [taken], maps).told == told
