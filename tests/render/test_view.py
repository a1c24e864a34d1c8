"""Views of cameras, lamps and far lights."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render import Camera
from hairfit.render.view import (
    camera_view,
    distant_view,
    lamp_view,
    light_axes,
    outermost,
    see_all,
)

POINTS = np.random.default_rng(0).uniform(-0.1, 0.1, (50, 3))


def make_camera() -> Camera:
    K = jnp.array([[300.0, 0.0, 120.0], [0.0, 310.0, 90.0], [0.0, 0.0, 1.0]])
    pose = jnp.eye(4).at[2, 3].set(0.8)
    return Camera(K, pose, 240, 180)


def test_a_cameras_view_lands_points_where_the_camera_does():
    camera = make_camera()
    seen = jax.vmap(camera_view(camera).see)(jnp.asarray(POINTS))
    expected = jax.vmap(camera.project)(jnp.asarray(POINTS))
    np.testing.assert_allclose(seen.pixel, expected.pixel, atol=1e-9)
    np.testing.assert_allclose(seen.depth, expected.depth, atol=1e-12)


def test_scale_is_the_size_of_a_metre_across_the_ray():
    camera = make_camera()
    view = camera_view(camera)
    p = jnp.array([0.02, -0.03, 0.05])
    J = jax.jacobian(lambda q: view.see(q).pixel)(p)[:, :2]
    area = jnp.abs(jnp.linalg.det(J))
    assert float(view.see(p).scale ** 2) == pytest.approx(float(area), rel=1e-9)


def test_nothing_is_seen_behind_the_eye():
    seen = camera_view(make_camera()).see(jnp.array([0.0, 0.0, -0.9]))
    assert float(seen.scale) == 0.0
    assert np.all(np.isfinite(seen.pixel))


@pytest.mark.parametrize("to_light", [(0.0, 1.0, 0.0), (0.5, 0.2, -0.9)])
def test_a_far_light_sees_all_points_by_parallel_rays(to_light):
    to_light = np.array(to_light)
    view = distant_view(to_light, POINTS, 64)
    seen = see_all(POINTS, view)
    assert (seen[:, :2] >= 1.999).all()
    assert (seen[:, :2] <= 62.001).all()
    # Towards the light only the depth changes, by the way gone.
    nearer = see_all(POINTS + 0.3 * to_light, view)
    np.testing.assert_allclose(nearer[:, :2], seen[:, :2], atol=1e-9)
    way = 0.3 * np.linalg.norm(to_light)
    np.testing.assert_allclose(seen[:, 2] - nearer[:, 2], way, atol=1e-12)


def test_a_lamp_sees_all_points_on_rays_from_itself():
    lamp = np.array([0.3, 0.5, 0.6])
    view = lamp_view(lamp, POINTS, 64)
    seen = see_all(POINTS, view)
    assert (seen[:, :2] >= 1.999).all()
    assert (seen[:, :2] <= 62.001).all()
    further = see_all(lamp + 1.5 * (POINTS - lamp), view)
    np.testing.assert_allclose(further[:, :2], seen[:, :2], atol=1e-9)
    np.testing.assert_allclose(further[:, 3], seen[:, 3] / 1.5, rtol=1e-9)


def test_numpy_and_jax_see_the_same():
    view = lamp_view(np.array([0.3, 0.5, 0.6]), POINTS, 64)
    seen = jax.vmap(view.see)(jnp.asarray(POINTS))
    out = see_all(POINTS, view)
    np.testing.assert_allclose(out[:, :2], seen.pixel, rtol=1e-12)
    np.testing.assert_allclose(out[:, 2], seen.depth, rtol=1e-12)
    np.testing.assert_allclose(out[:, 3], seen.scale, rtol=1e-12)


def test_axes_are_right_handed_and_the_last_runs_from_the_light():
    axes = light_axes(np.array([0.0, 2.0, 0.0]))
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(axes[2], [0.0, -1.0, 0.0])


def test_lights_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="needs a length"):
        light_axes(np.zeros(3))
    with pytest.raises(ValueError, match="within the hair; move it away"):
        lamp_view(np.zeros(3), POINTS, 64)
    with pytest.raises(ValueError, match="at least one point"):
        distant_view(np.ones(3), np.zeros((0, 3)), 64)


def test_outermost_points_bound_all_of_them():
    points = np.random.default_rng(1).normal(size=(2000, 3))
    few = outermost(points)
    assert len(few) < 200
    for way in np.random.default_rng(2).normal(size=(50, 3)):
        assert (points @ way).max() == (few @ way).max()
    level = points * [1.0, 0.0, 1.0]
    np.testing.assert_array_equal(outermost(level), level)
    np.testing.assert_array_equal(outermost(points[:2]), points[:2])
