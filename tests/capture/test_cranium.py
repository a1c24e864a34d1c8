import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from hairfit.capture.cranium import (
    CENTRE_BELOW_TOP,
    WIDTH,
    Cranium,
    even_directions,
    find_cranium,
    skin_distance,
)
from hairfit.types import Mesh

ADULT = WIDTH / 2 * np.array([1.0, 1.4, 1.25])  # half axes of a head


def ellipsoid(half=ADULT, centre=(0.0, 0.0, 0.0)):
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    vertices = np.asarray(mesh.vertices) * half + np.asarray(centre)
    return Mesh(vertices, np.asarray(mesh.faces, np.int64))


def test_the_cranium_of_an_adult_has_size_one():
    found = find_cranium(ellipsoid())
    assert np.isclose(found.size, 1.0, atol=0.02)
    expected = [0.0, ADULT[1] - CENTRE_BELOW_TOP, 0.0]
    assert np.allclose(found.centre, expected, atol=0.003)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.6, 1.6), st.tuples(*[st.floats(-5.0, 5.0)] * 3))
def test_it_grows_and_moves_with_the_head(scale, shift):
    one = find_cranium(ellipsoid())
    found = find_cranium(ellipsoid(scale * ADULT, shift))
    assert np.isclose(found.size, scale * one.size, rtol=0.01)
    assert np.allclose(found.centre, scale * one.centre + shift, atol=1e-3)


def test_shoulders_do_not_matter():
    plain = ellipsoid()
    box = trimesh.creation.box((0.5, 0.2, 0.2))
    low = np.asarray(box.vertices) - [0.0, 0.3, 0.0]
    faces = np.asarray(box.faces, np.int64) + len(plain.vertices)
    both = Mesh(
        np.concatenate([plain.vertices, low]), np.concatenate([plain.faces, faces])
    )
    one, other = find_cranium(plain), find_cranium(both)
    assert np.allclose(one.centre, other.centre) and one.size == other.size


def test_the_polar_frame_is_right_handed_and_leans_back():
    axes = find_cranium(ellipsoid()).axes
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    left, face, pole = axes
    assert np.allclose(left, [1, 0, 0])
    assert np.allclose(np.cross(pole, face), left, atol=1e-12)
    assert pole[1] > 0.9 and pole[2] < 0 < face[2]


def test_directions_start_at_the_face_and_turn_to_the_left():
    cranium = find_cranium(ellipsoid())
    right_angle = np.full(4, np.pi / 2)
    found = cranium.direction(right_angle, np.radians([0, 90, 180, 270]))
    left, face, pole = cranium.axes
    assert np.allclose(found, [face, left, -face, -left], atol=1e-12)
    top = cranium.direction(np.zeros(2), np.array([0.0, 2.0]))
    assert np.allclose(top, pole, atol=1e-12)
    rng = np.random.default_rng(0)
    polar, azimuth = rng.uniform(0, np.pi, 50), rng.uniform(-9, 9, 50)
    some = cranium.direction(polar, azimuth)
    assert np.allclose(np.linalg.norm(some, axis=1), 1.0, atol=1e-12)
    assert np.allclose(some @ pole, np.cos(polar), atol=1e-12)


@pytest.fixture
def ball():
    return ellipsoid(np.full(3, 0.09), centre=(1.0, 2.0, 3.0))


def some_rays(count=100):
    rays = np.random.default_rng(1).normal(size=(count, 3))
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def test_the_skin_of_a_ball_is_where_rays_leave_it(ball):
    offset = np.array([0.01, -0.02, 0.015])
    cranium = Cranium(np.array([1.0, 2.0, 3.0]) + offset, np.eye(3), 1.0)
    rays = some_rays()
    along = rays @ offset
    expected = -along + np.sqrt(along**2 - offset @ offset + 0.09**2)
    assert np.abs(skin_distance(ball, cranium, rays) - expected).max() < 2e-4


def test_of_several_skins_the_outermost_counts(ball):
    inner = ellipsoid(np.full(3, 0.05), centre=(1.0, 2.0, 3.0))
    both = Mesh(
        np.concatenate([inner.vertices, ball.vertices]),
        np.concatenate([inner.faces, ball.faces + len(inner.vertices)]),
    )
    cranium = Cranium(np.array([1.0, 2.0, 3.0]), np.eye(3), 1.0)
    assert np.allclose(skin_distance(both, cranium, some_rays()), 0.09, atol=2e-4)


def test_rays_that_meet_nothing_near_get_the_median_of_the_others():
    bowl = ellipsoid(np.full(3, 0.09))
    middle = bowl.vertices[bowl.faces].mean(axis=1)
    far = ellipsoid(np.full(3, 0.4))  # shoulders
    keep = bowl.faces[middle[:, 1] > 0.0]
    both = Mesh(
        np.concatenate([bowl.vertices, far.vertices]),
        np.concatenate([keep, far.faces + len(bowl.vertices)]),
    )
    cranium = Cranium(np.zeros(3), np.eye(3), 1.0)
    rays = some_rays()
    found = skin_distance(both, cranium, rays)
    assert np.allclose(found, 0.09, atol=3e-4)


@pytest.mark.parametrize("lowest", [0.0, -1.0])
def test_even_directions_are_as_dense_everywhere(lowest):
    ways = even_directions(2000, lowest)
    assert np.allclose(np.linalg.norm(ways, axis=1), 1.0, atol=1e-12)
    assert ways[:, 1].min() > lowest
    # Caps of a tenth of what they fill hold a tenth of them.
    area = 0.1 * (1.0 - lowest)
    for axis in ([0.0, 1.0, 0.0], [0.36, 0.8, 0.48], [-0.48, 0.8, 0.36]):
        share = np.mean(ways @ np.array(axis) > 1.0 - area)
        assert share == pytest.approx(0.1, abs=0.01)
