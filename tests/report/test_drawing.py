import numpy as np
import pytest

from hairfit.render.gl import NoContextError
from hairfit.render.raster import project_points
from hairfit.report.drawing import draw_hair, orbit_camera


@pytest.fixture
def points():
    return np.random.default_rng(0).normal(0.2, 0.1, (20, 5, 3))


@pytest.mark.parametrize("size", [(60, 40), (40, 60)])
@pytest.mark.parametrize("elevation", [-np.pi / 2, 0.3, np.pi / 2])
def test_all_hair_is_in_the_picture(points, size, elevation):
    camera = orbit_camera(points, 2.0, elevation, size)
    pixel, depth = project_points(points, camera)
    assert (depth > 0).all()
    assert (pixel >= 0).all() and (pixel <= size).all()
    assert np.ptp(pixel, axis=(0, 1)).max() > 0.4 * min(size)
    rotation = np.asarray(camera.cam_from_world)[:3, :3]
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
    assert np.isclose(np.linalg.det(rotation), 1.0, atol=1e-6)


def test_azimuth_turns_from_the_face_to_the_persons_left(points):
    middle = (points.min(axis=(0, 1)) + points.max(axis=(0, 1))) / 2
    for azimuth, axis in ((0.0, 2), (np.pi / 2, 0)):
        away = np.asarray(orbit_camera(points, azimuth, 0.0, (40, 40)).centre) - middle
        assert np.argmax(away) == axis and away[axis] > 0
        assert np.allclose(np.delete(away, axis), 0.0, atol=1e-5)
    # The person's left (+x) is on the right of a picture from the front, up is up.
    camera = orbit_camera(points, 0.0, 0.0, (40, 40))
    left_and_up = project_points(middle + [0.05, 0.05, 0.0], camera).pixel
    assert left_and_up[0] > 20 and left_and_up[1] < 20


def test_jax_draws_previews_where_there_is_no_opengl(points, monkeypatch):
    def refuse():
        raise NoContextError("no OpenGL here.")

    monkeypatch.setattr("hairfit.report.engines.open_context", refuse)
    camera = orbit_camera(points, 0.0, 0.0, (20, 30))
    (picture,) = draw_hair(points, None, [camera])
    assert picture.shape == (30, 20, 3) and picture.dtype == np.uint8
    # Brown hair before a light background.
    assert picture[0, 0].min() > 200
    red, _, blue = picture.reshape(-1, 3)[picture.sum(-1).argmin()]
    assert red > blue + 10
