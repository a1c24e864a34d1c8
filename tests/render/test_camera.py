import jax
import jax.numpy as jnp
from jax.test_util import check_grads

from hairfit.render import Camera

K = jnp.array([[500.0, 0.0, 320.0], [0.0, 510.0, 240.0], [0.0, 0.0, 1.0]])


def turned(angle):
    c, s = jnp.cos(angle), jnp.sin(angle)
    view = jnp.eye(4).at[:3, :3].set(jnp.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))
    return view.at[:3, 3].set(jnp.array([0.1, 0.2, 0.5]))


def test_a_point_on_the_axis_lands_at_the_principal_point():
    found = Camera(K, jnp.eye(4), 640, 480).project(jnp.array([0.0, 0.0, 2.0]))
    assert jnp.allclose(found.pixel, jnp.array([320.0, 240.0]))
    assert found.depth == 2.0


def test_x_runs_right_and_y_down():
    found = Camera(K, jnp.eye(4), 640, 480).project(jnp.array([0.1, 0.2, 2.0]))
    assert jnp.allclose(found.pixel, jnp.array([320.0 + 25.0, 240.0 + 51.0]))


def test_the_centre_lands_nowhere_and_has_no_depth():
    camera = Camera(K, turned(0.4), 640, 480)
    assert jnp.allclose(camera.project(camera.centre).depth, 0.0, atol=1e-12)
    assert jnp.isfinite(camera.project(camera.centre).pixel).all()


def test_points_behind_the_camera_have_negative_depth():
    camera = Camera(K, jnp.eye(4), 640, 480)
    assert camera.project(jnp.array([0.0, 0.0, -1.0])).depth == -1.0


def test_gradients_of_a_pixel_are_those_of_finite_differences():
    camera = Camera(K, turned(0.4), 640, 480)
    p = jnp.array([0.1, -0.3, 1.2])
    check_grads(jax.jit(lambda q: camera.project(q).pixel), (p,), order=1)
