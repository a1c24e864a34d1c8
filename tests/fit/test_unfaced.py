import numpy as np
import pytest
from ball_hair import RADIUS, ball, camera_at, ring, sphere_depth, view_of

from hairfit.capture.distance import signed_distance
from hairfit.fit.hull import carve
from hairfit.fit.unfaced import (
    FACED,
    LEVEL,
    TOP,
    WAYS,
    highest,
    places_around,
    unfaced_side,
    unfaced_ways,
    with_unfaced,
)
from hairfit.render import mesh_depth
from hairfit.render.raster import project_points

pytestmark = pytest.mark.usefixtures("small_room")

HAIR, SPACING = 0.11, 0.006
CENTRE = np.zeros(3)


@pytest.fixture(scope="module")
def head():
    return ball()


def in_front():
    """Return the three cameras in front of a ring of eight."""
    cameras = ring(8)
    return [cameras[k] for k in (0, 1, 7)]


def carved(cameras, head, above=-1.0):
    """Return the hull of a ball of hair above a plane, its views and the depths."""
    views = []
    for k, camera in enumerate(cameras):
        near = sphere_depth(camera, HAIR)
        rows = np.arange(camera.height)[:, None]
        horizon = project_points(np.array([[0.0, above, 0.0]]), camera).pixel[0, 1]
        views.append(view_of(camera, np.isfinite(near) & (rows < horizon), f"{k:02d}"))
    depths = [mesh_depth(head, camera) for camera in cameras]
    return carve(views, depths, head, SPACING), views, depths


def test_a_camera_faces_the_ways_that_it_sees_well():
    ways = (np.arange(WAYS) + 0.5) * 360.0 / WAYS
    aside = np.abs((ways - 90.0 + 180.0) % 360.0 - 180.0)
    left = view_of(camera_at([0.6, 0.1, 0.0]), np.zeros((1, 1), bool))
    above = view_of(camera_at([0.01, 0.6, 0.0]), np.zeros((1, 1), bool))
    for views in ([left], [left, above]):
        found = unfaced_ways(views, CENTRE)
        assert np.array_equal(found, aside > np.degrees(FACED))
    assert unfaced_ways([above], CENTRE).all()


@pytest.mark.parametrize("count", [3, 4, 8])
def test_no_way_is_unfaced_by_photographs_all_around(count):
    views = [view_of(camera, np.zeros((1, 1), bool)) for camera in ring(count)]
    assert not unfaced_ways(views, CENTRE).any()
    assert unfaced_side(views, ball()) is None


@pytest.mark.parametrize(
    ("eyes", "side"),
    [
        ([[0.0, 0.1, 0.6]], "back of the head, over 210 degrees"),
        (
            [[0.0, 0.1, 0.6], [0.6, 0.1, 0.0], [0.0, 0.1, -0.6]],
            "right of the head, over 30",
        ),
        (
            [[0.0, 0.1, 0.6], [-0.6, 0.1, 0.0], [0.0, 0.1, -0.6]],
            "left of the head, over 30",
        ),
        ([[0.0, 0.1, -0.6]], "front of the head"),
    ],
)
def test_the_side_that_no_photograph_faces_is_told(head, eyes, side):
    views = [view_of(camera_at(eye), np.zeros((1, 1), bool)) for eye in eyes]
    assert (unfaced_side(views, head) or "").startswith("the " + side)


def test_what_photographs_all_around_show_stays_as_it_is(head):
    hull, views, depths = carved(ring(4), head)
    assert with_unfaced(hull, views, depths, head) is hull


def test_places_are_levels_and_ways_to_the_left_from_the_face():
    angle = np.radians([2.0, 92.0, 182.0, 358.0])
    points = np.stack([np.sin(angle), np.full(4, 2.5 * LEVEL), np.cos(angle)], axis=1)
    level, way = places_around(points + 0.1, CENTRE + 0.1)
    assert level.tolist() == [2] * 4
    assert way.tolist() == [0, WAYS // 4, WAYS // 2, WAYS - 1]


def test_hair_of_a_place_is_as_high_as_nine_tenths_of_it():
    rng = np.random.default_rng(0)
    level, way = rng.integers(0, 5, 4000), rng.integers(0, 7, 4000)
    height = rng.random(4000)
    found = highest(level, way, height)
    assert found.shape == (5, WAYS)
    for k in range(5):
        for j in range(7):
            here = np.sort(height[(level == k) & (way == j)])
            assert found[k, j] == here[int(TOP * (len(here) - 1))]
    assert not found[:, 7:].any()


def test_hair_seen_from_in_front_goes_on_at_the_back(head):
    hull, views, depths = carved(in_front(), head)
    whole = with_unfaced(hull, views, depths, head)
    points = whole.grid.centres(np.ones(whole.grid.shape, bool))
    away = np.linalg.norm(points, axis=1)
    # Around the middle, where levels cut the ball across.
    back = (points[:, 2] < -0.5 * away) & (np.abs(points[:, 1]) < 0.03)
    hair = back & (away > RADIUS + SPACING) & (away < RADIUS + 0.7 * (HAIR - RADIUS))
    assert hair.sum() > 300
    assert whole.hair.ravel()[hair].all()
    assert (hull.distance_at(points[hair]) < 0.0).mean() < 0.8
    added = whole.hair.ravel() & ~(hull.distance_at(points) < 0.0)
    assert away[added].min() > RADIUS - 0.001
    assert away[added & (np.abs(points[:, 1]) < 0.03)].max() < HAIR + SPACING
    near = np.abs(whole.head.ravel() - signed_distance(head, points)) < 1e-9
    assert near[whole.hair.ravel()].all()
    # What is seen stays.
    assert (whole.distance_at(hull.grid.centres(hull.hair)) < 0.0).all()


def test_where_no_hair_is_on_both_sides_none_is_at_the_back(head):
    above = 0.03
    hull, views, depths = carved(in_front(), head, above)
    lowest = hull.grid.centres(hull.hair)[:, 1].min()
    whole = with_unfaced(hull, views, depths, head)
    added = whole.grid.centres(whole.hair)
    assert len(added) > hull.hair.sum() + 100
    assert added[:, 1].min() > lowest - LEVEL


def test_no_hair_is_where_a_photograph_shows_none(head):
    hull, views, depths = carved(in_front(), head)
    from_above = camera_at([0.01, 0.6, 0.0])
    bald = view_of(from_above, np.zeros_like(views[0].hair))
    views, depths = [*views, bald], [*depths, mesh_depth(head, from_above)]
    whole = with_unfaced(hull, views, depths, head)
    added = whole.grid.centres(whole.hair)
    added = added[~(hull.distance_at(added) < 0.0)]
    assert len(added) > 50
    depth = depths[-1]
    pixel, z = project_points(added, from_above)
    x, y = np.floor(pixel).astype(int).T
    assert (z > depth[y, x]).all()
