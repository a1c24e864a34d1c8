import numpy as np
import pytest
from ball_hair import RADIUS, ball, hull_where, ring, sphere_depth, view_of

from hairfit.fit.corners import KEPT, carve_corners
from hairfit.fit.hull import carve
from hairfit.render import mesh_depth
from hairfit.render.raster import project_points

HAIR, SPACING = 0.11, 0.005


@pytest.fixture(autouse=True)
def small_room(monkeypatch):
    """Search no farther than there is something here."""
    monkeypatch.setattr("hairfit.fit.hull.REACH", 0.2)


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
