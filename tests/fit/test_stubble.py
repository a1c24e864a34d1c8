import dataclasses

import numpy as np
import pytest
from ball_hair import RADIUS, ball, hull_where, meridian, photograph, ring

from hairfit.fit.evidence import gather
from hairfit.fit.hull import hull_of
from hairfit.fit.stubble import SHAVED, find_stubble, thin_hair

SPACING = 0.003
LEAN = np.radians(20.0)


def shell(height):
    """Return the hull of hair up to a height above the ball, where it looks up."""
    size = RADIUS + height + 3 * SPACING

    def skin(points):
        return np.linalg.norm(points, axis=1) - RADIUS

    def hair(points):
        return (skin(points) > 0) & (skin(points) < height) & (points[:, 1] > 0.03)

    return hull_where(hair, [-size] * 3, [size] * 3, SPACING, skin)


def out_of(hull):
    """Return the directions of the skin's normal, and of a lean from it to +z."""
    points = hull.grid.centres(hull.hair)
    normal = points / np.linalg.norm(points, axis=1, keepdims=True)
    aside = np.array([0.0, 0.0, 1.0]) - normal[:, 2:] * normal
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    return normal, np.cos(LEAN) * normal + np.sin(LEAN) * aside


def planes_of(direction, error, views=3, sure=0.05, seed=0):
    """Return the sum of planes that hold a direction, but for an angle each."""
    rng = np.random.default_rng(seed)
    planes = np.zeros((len(direction), 3, 3))
    for _ in range(views):
        eye = rng.normal(size=3)
        normal = np.cross(direction, eye / np.linalg.norm(eye))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        normal += rng.normal(0.0, error, (len(direction), 1)) * direction
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        planes += sure * normal[:, :, None] * normal[:, None, :]
    total = np.full(len(direction), views * sure)
    return planes, total, np.full(len(direction), float(views)), views


@pytest.fixture(scope="module")
def shaved():
    return shell(0.009)


def test_planes_that_err_a_lot_tell_the_lean_of_stubble_together(shaved):
    _, leaning = out_of(shaved)
    stands, direction = find_stubble(
        shaved, thin_hair(shaved), *planes_of(leaning, 0.3)
    )
    assert stands.mean() > 0.95
    off = np.degrees(np.arccos(np.clip((direction * leaning[stands]).sum(1), -1, 1)))
    unsigned = np.minimum(off, 180.0 - off)
    assert np.median(unsigned) < 5.0 and np.quantile(unsigned, 0.95) < 12.0


def test_where_views_agree_on_a_plane_only_stubble_stands_upright_in_it(shaved):
    normal, leaning = out_of(shaved)
    stands, direction = find_stubble(
        shaved, thin_hair(shaved), *planes_of(leaning, 0.0, views=1)
    )
    upright = np.abs((direction * normal[stands]).sum(1))
    assert stands.mean() > 0.95
    # In the plane, no direction is nearer to the normal than the lean is.
    assert np.quantile(upright, 0.1) > np.cos(LEAN) - 0.05


def test_thin_hair_that_lies_on_the_skin_is_no_stubble(shaved):
    normal, leaning = out_of(shaved)
    across = np.cross(normal, leaning)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    stands, direction = find_stubble(shaved, thin_hair(shaved), *planes_of(across, 0.1))
    assert not stands.any() and direction.shape == (0, 3)


def test_hair_that_stands_high_is_left_as_it_is_seen():
    brush = shell(0.03)
    assert not find_stubble(
        brush, thin_hair(brush), *planes_of(out_of(brush)[0], 0.1)
    ).stands.any()


def test_what_no_view_looks_at_is_no_stubble(shaved):
    planes, total, looks, count = planes_of(out_of(shaved)[1], 0.1)
    back = shaved.grid.centres(shaved.hair)[:, 2] < 0.0
    seen = np.where(back, 0.01, 1.0)
    stands = find_stubble(
        shaved,
        thin_hair(shaved),
        seen[:, None, None] * planes,
        seen * total,
        seen * looks,
        count,
    ).stands
    far = shaved.grid.centres(shaved.hair)[:, 2]
    assert stands[far > 0.03].mean() > 0.95 and not stands[far < -0.03].any()


def test_few_photographs_tell_a_shaved_head_though_not_a_small_place(shaved):
    # Each place is seen by a third of a view, in the mean.
    def hardly_seen(hull, count):
        planes, total, looks, _ = planes_of(out_of(hull)[1], 0.1, views=1)
        return find_stubble(
            hull, thin_hair(hull), planes / 3.0, total / 3.0, looks / 3.0, count
        ).stands

    assert hardly_seen(shaved, 3).mean() > 0.95
    at = shaved.grid.centres(shaved.hair)
    place = np.zeros_like(shaved.hair)
    place[shaved.hair] = np.linalg.norm(at - [0.0, RADIUS, 0.0], axis=1) < 0.025
    assert 0.0 < place.sum() * SPACING**3 < SHAVED
    assert not hardly_seen(hull_of(shaved.grid, place, shaved.head), 3).any()
    # Of so many photographs more would have seen it.
    assert not hardly_seen(shaved, 8).any()


def test_hair_combed_level_lies_on_the_skin_also_before_a_level_ring(shaved):
    # All planes are level, or nearly: they hold the skin's normal at the sides.
    turn = np.linspace(0.0, 2.0, 12)
    start = np.random.default_rng(0).uniform(0.0, 2 * np.pi, 3000)
    polar = np.linspace(np.radians(70.0), np.radians(88.0), len(start))[:, None]
    strands = meridian(polar, start[:, None] + turn, 0.004)
    views, maps, depths = photograph(strands, ring(8), ball())
    found = gather(shaved, views, maps, depths)
    normal = out_of(shaved)[0]
    upright = np.abs((found.direction * normal).sum(1))[found.weight > 0.1]
    assert found.stubble is not None and not found.stubble.any()
    assert len(upright) > 500 and np.median(upright) < np.sin(np.radians(15.0))


@pytest.mark.parametrize("sure", [0.05, 0.5])
def test_photographs_of_a_shaved_head_show_hair_that_stands(shaved, sure):
    rng = np.random.default_rng(0)
    out = rng.normal(size=(6000, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    out = out[out[:, 1] > 0.3]
    far = RADIUS + np.linspace(0.0, 0.008, 6)
    strands = far[None, :, None] * out[:, None, :]
    views, maps, depths = photograph(strands, ring(6, finer=3), ball(), radius_px=0.5)
    unsure = [
        dataclasses.replace(found, confidence=sure * found.confidence) for found in maps
    ]
    found = gather(shaved, views, unsure, depths)
    upright = np.abs((found.direction * out_of(shaved)[0]).sum(1))
    # A ring of cameras does not see the crown's hair from the side.
    side = shaved.grid.centres(shaved.hair)[:, 1] < 0.06
    assert np.median(upright[side]) > np.cos(np.radians(10.0))
    assert (found.weight[side] >= 1.0).mean() > 0.9
