import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from hairfit.capture.distance import CELL, Skin, head_field, push_out, signed_distance
from hairfit.model.collide import push_out_points
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


def test_a_look_up_never_says_more_than_the_distance_and_little_less(ball, points):
    skin = Skin(mesh_of(ball))
    least, exact = skin.least_distance(points), skin.nearest(points).distance
    assert (least <= exact).all()
    inside = np.abs(points - CENTRE).max(axis=1) < RADIUS
    # Half of a cell's diagonal away from the grid's point, and back.
    assert (exact - least)[inside].max() < 1.01 * np.sqrt(3) * CELL
    far = np.array([[5.0, 0.0, 0.0], [0.0, -3.0, 0.0]])
    assert (skin.least_distance(far) > 2.0).all()


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
    found = push_out(Skin(mesh_of(ball)), points, gap)
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
    found = push_out(Skin(mesh_of(ball)), outside, 0.001)
    assert np.array_equal(found, outside)
    assert found is not outside


def test_the_field_of_a_head_holds_its_distances(ball):
    field = head_field(mesh_of(ball), 0.008, 0.02)
    origin, shape = np.asarray(field.origin), field.distance.shape
    assert np.allclose(origin, CENTRE - RADIUS - 0.02, atol=FACETS)
    last = origin + 0.008 * (np.array(shape) - 1)
    assert (last >= CENTRE + RADIUS + 0.02 - 2 * FACETS).all()
    assert (last < CENTRE + RADIUS + 0.02 + 0.008).all()
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    exact = from_centre(origin + 0.008 * index.reshape(-1, 3)) - RADIUS
    assert np.abs(field.distance.reshape(-1) - exact).max() < FACETS


def test_the_field_moves_points_as_the_mesh_does(ball, points):
    head, gap = mesh_of(ball), 0.0005
    shallow = points[from_centre(points) > 0.9 * RADIUS]
    found = push_out_points(head_field(head), jnp.asarray(shallow), gap)
    slow = push_out(Skin(head), shallow, gap)
    # The mesh moves what is inside, the field what is below the gap; deeper points land
    # apart, as the mesh has facets.
    clear = np.abs(from_centre(shallow) - RADIUS) > 2 * gap
    assert clear.sum() > 150
    assert np.abs(np.asarray(found) - slow)[clear].max() < 5e-4
