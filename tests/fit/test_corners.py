import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import RADIUS, ball, camera_at, hull_where, ring, sphere_depth, view_of

from hairfit.fit.corners import KEPT, LOWEST, carve_corners, crossed, look, sticking_out
from hairfit.fit.hull import carve
from hairfit.render import mesh_depth
from hairfit.render.raster import project_points

pytestmark = pytest.mark.usefixtures("small_room")

HAIR, SPACING = 0.11, 0.005


@pytest.fixture(scope="module")
def views():
    """Four photographs of a ball of hair, around the head."""
    return [
        view_of(camera, np.isfinite(sphere_depth(camera, HAIR))) for camera in ring(4)
    ]


@pytest.fixture(scope="module")
def depths(views):
    return [mesh_depth(ball(), view.camera) for view in views]


@pytest.fixture
def hulls(views, depths):
    hull = carve(views, depths, ball(), SPACING)
    return hull, carve_corners(hull, views, depths)


def covered(hull, view, depth):
    """Return the pixels that a hull's voxels before the head colour."""
    pixels = project_points(hull.grid.centres(hull.hair), view.camera)
    x, y = np.floor(pixels.pixel).astype(int).T
    out = np.zeros_like(view.hair)
    front = pixels.depth < depth[y, x]
    # A voxel is 1.3 to 1.7 pixels wide here.
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            row = np.clip(y[front] + dy, 0, view.hair.shape[0] - 1)
            out[row, np.clip(x[front] + dx, 0, view.hair.shape[1] - 1)] = True
    return out & view.hair


def test_corners_of_the_hull_of_a_ball_go_and_the_ball_stays(hulls):
    before, after = hulls
    assert not (after.hair & ~before.hair).any()
    away = np.linalg.norm(before.grid.centres(before.hair), axis=1)
    left = after.hair[before.hair]
    corner = away > HAIR + 0.01
    assert corner.sum() > 2000
    assert (left & corner).sum() < 0.5 * corner.sum()
    inside = away < HAIR
    assert (left & inside).sum() > 0.97 * inside.sum()


def test_every_photograph_keeps_hair_behind_its_pixels(hulls, views, depths):
    before, after = hulls
    for view, depth in zip(views, depths, strict=True):
        lost = covered(before, view, depth) & ~covered(after, view, depth)
        assert lost.sum() <= 0.002 * view.hair.sum()


def test_a_lock_thinner_than_what_rays_keep_stays_whole(depths):
    radius = 0.35 * KEPT

    def lock(p):
        beside = np.hypot(p[:, 0] - RADIUS - 0.01, p[:, 2])
        return (beside < radius) & (np.abs(p[:, 1]) < 0.05)

    hull = hull_where(lock, [-0.12] * 3, [0.12] * 3, 0.004)
    views = [
        view_of(camera, np.ones((camera.height, camera.width), bool))
        for camera in ring(4)
    ]
    free = [np.full_like(depth, np.inf) for depth in depths]
    assert np.array_equal(carve_corners(hull, views, free).hair, hull.hair)


BUN, AT = 0.035, np.array([0.0, 0.02, -0.14])


def bun_depth(camera):
    """Return the depth of a ball of hair with a bun at its back."""
    pose = np.asarray(camera.cam_from_world, float)
    bun = dataclasses.replace(
        camera, cam_from_world=jnp.asarray(pose @ shift(AT), jnp.float32)
    )
    return np.minimum(sphere_depth(camera, HAIR - 0.02), sphere_depth(bun, BUN))


def shift(by):
    out = np.eye(4)
    out[:3, 3] = by
    return out


def bunned(*turns):
    """Return photographs of that hair from so many degrees round the head."""
    cameras = [
        camera_at(0.6 * np.array([np.sin(turn), 0.1, np.cos(turn)]))
        for turn in np.radians(turns)
    ]
    views = [view_of(camera, np.isfinite(bun_depth(camera))) for camera in cameras]
    return views, [mesh_depth(ball(), view.camera) for view in views]


def test_a_bun_that_two_outlines_show_is_no_corner():
    views, depths = bunned(0.0, 135.0, 225.0)
    hull = carve(views, depths, ball(), 0.004)
    left = carve_corners(hull, views, depths).hair[hull.hair]
    centres = hull.grid.centres(hull.hair)
    bun = np.linalg.norm(centres - AT, axis=1) < BUN - 0.004
    assert left[bun].mean() > 0.97
    # Other corners, and what lies between them and the hair, go as before.
    ball_of_hair = np.linalg.norm(centres, axis=1) < HAIR - 0.008
    ghost = ~ball_of_hair & (np.linalg.norm(centres - AT, axis=1) > BUN + 0.012)
    assert left[ghost].mean() < 0.5


def crossed_by(hull, views, depths):
    pairs = zip(views, depths, strict=True)
    return crossed(hull, views, [look(hull, *pair).out for pair in pairs])


def test_what_two_views_from_one_side_and_the_other_see_does_not_cross():
    views, depths = bunned(90.0, 270.0)
    hull = carve(views, depths, ball(), 0.004)
    assert not crossed_by(hull, views, depths).any()
    both, depths = bunned(135.0, 225.0)
    hull = carve(both, depths, ball(), 0.004)
    found = hull.grid.centres(hull.hair)[crossed_by(hull, both, depths)]
    assert len(found) > 100
    assert np.linalg.norm(found - AT, axis=1).max() < 2.0 * BUN


def test_what_sticks_out_of_an_outline_is_what_no_disc_fills():
    (view,), (depth,) = bunned(90.0)
    pixel = 0.6 / view.camera.focal
    found = sticking_out(view, np.full_like(depth, np.inf), pixel)
    y, x = np.nonzero(found)
    centre = project_points(AT[None], view.camera).pixel[0]
    assert np.hypot(x - centre[0], y - centre[1]).max() * pixel < 1.1 * BUN
    assert found.sum() * pixel**2 > 0.5 * np.pi * BUN**2
    # A lower one does not count.
    across = np.arange(view.camera.width) - 0.5 * view.camera.width
    side = np.sign(centre[0] - 0.5 * view.camera.width)
    cut = dataclasses.replace(view, hair=view.hair & (side * across * pixel < 0.11))
    assert (view.hair & ~cut.hair).any()
    assert not sticking_out(cut, np.full_like(depth, np.inf), pixel).any()


def test_hair_is_no_higher_all_around_than_outlines_show(views, depths):
    # Corners of a hull of three views go only as far as they stick out.
    views, depths = views[:3], depths[:3]
    hull = carve(views, depths, ball(), SPACING)
    left = carve_corners(hull, views, depths).hair[hull.hair]
    away = np.linalg.norm(hull.grid.centres(hull.hair), axis=1)
    assert (away > HAIR + 0.015).sum() > 1000
    # Voxels, and the pixels of the masks, are known to a voxel and a pixel.
    assert away[left].max() < HAIR + 0.008 + LOWEST
    inside = away < HAIR
    assert left[inside].mean() > 0.97
