import numpy as np
import pytest
import trimesh

from hairfit.capture.distance import push_out, signed_distance
from hairfit.types import Mesh

RADIUS, CENTRE = 0.09, np.array([0.3, -0.2, 0.5])
FACETS = 2e-4  # how far the mesh is from the ball that it stands for


def mesh_of(ball):
    return Mesh(np.asarray(ball.vertices) + CENTRE, np.asarray(ball.faces, np.int64))


@pytest.fixture(scope="module")
def ball():
    return trimesh.creation.icosphere(subdivisions=4, radius=RADIUS)


@pytest.fixture
def points():
    rng = np.random.default_rng(0)
    out = rng.normal(size=(400, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    return CENTRE + out * rng.uniform(0.2, 2.0, (400, 1)) * RADIUS


def from_centre(points):
    return np.linalg.norm(points - CENTRE, axis=1)


def test_the_distance_to_a_ball_is_known(ball, points):
    found = signed_distance(mesh_of(ball), points)
    assert np.abs(found - (from_centre(points) - RADIUS)).max() < FACETS


def test_one_point_is_enough(ball):
    found = signed_distance(mesh_of(ball), CENTRE[None])
    assert found.shape == (1,) and np.isclose(found[0], -RADIUS, atol=FACETS)


def test_a_head_that_is_open_at_the_neck_has_an_inside(ball, points):
    keep = ball.triangles_center[:, 1] > -0.8 * RADIUS
    opened = Mesh(ball.vertices + CENTRE, np.asarray(ball.faces[keep], np.int64))
    upper = points[:, 1] > CENTRE[1]
    found = signed_distance(opened, points[upper])
    expected = from_centre(points[upper]) - RADIUS
    clear = np.abs(expected) > FACETS
    assert np.array_equal(found[clear] < 0, expected[clear] < 0)


def test_parts_that_overlap_are_one_inside(ball, points):
    both = trimesh.util.concatenate([ball, ball.copy().apply_scale(0.8)])
    found = signed_distance(mesh_of(both), points)
    clear = np.abs(from_centre(points) - RADIUS) > FACETS
    assert np.array_equal(found[clear] < 0, from_centre(points[clear]) < RADIUS)


def test_what_is_inside_is_laid_above_the_skin_and_the_rest_stays(ball, points):
    gap = 0.0005
    found = push_out(mesh_of(ball), points, gap)
    inside = from_centre(points) < RADIUS - FACETS
    outside = from_centre(points) > RADIUS + FACETS
    assert inside.sum() > 100 and outside.sum() > 100
    assert np.array_equal(found[outside], points[outside])
    assert np.abs(from_centre(found[inside]) - RADIUS - gap).max() < 2 * FACETS
    # Along the shortest way, which is the radius.
    way = (found - points)[inside]
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    radius = (points - CENTRE)[inside] / from_centre(points)[inside, None]
    deep = from_centre(points)[inside] < 0.8 * RADIUS
    assert ((way * radius).sum(axis=1)[~deep] > 0.95).all()


def test_nothing_is_changed_where_nothing_is_inside(ball, points):
    outside = points[from_centre(points) > RADIUS + FACETS]
    found = push_out(mesh_of(ball), outside, 0.001)
    assert np.array_equal(found, outside)
    assert found is not outside
