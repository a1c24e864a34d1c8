"""Pictures for the eye, and what is said where there is no OpenGL."""

import subprocess
import sys
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from hairfit import InputError
from hairfit.render import Camera
from hairfit.render.gl import NoContextError, draw_frames
from hairfit.render.gl.context import COMPUTE, open_context
from hairfit.render.gl.solid import Solid, clip_from_world
from hairfit.render.studio import preview_scene, shown_width, studio_lights
from hairfit.render.view import camera_view, distant_view, see_all
from hairfit.types import Mesh


@pytest.fixture
def camera():
    K = jnp.array([[100.0, 0.0, 30.0], [0.0, 100.0, 20.0], [0.0, 0.0, 1.0]])
    return Camera(K, jnp.eye(4), 64, 48)


def test_each_camera_has_a_picture_and_it_is_the_same_each_time(context, bob, camera):
    scene = preview_scene(bob + [0.0, 0.0, 1.0], None)
    first = draw_frames(scene, [camera, camera], lights_of=studio_lights)
    again = draw_frames(scene, [camera], lights_of=studio_lights)
    assert len(first) == 2
    assert first[0].shape == (48, 64, 4)
    np.testing.assert_array_equal(first[0], first[1])
    np.testing.assert_array_equal(first[0], again[0])


def test_lights_move_with_the_camera(camera):
    turn = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    pose = jnp.eye(4).at[:3, :3].set(turn)
    turned = Camera(camera.K, pose, 64, 48)
    for here, there in zip(studio_lights(camera), studio_lights(turned), strict=True):
        in_camera = turn @ np.asarray(there.to_light)
        np.testing.assert_allclose(in_camera, here.to_light, atol=1e-12)


@pytest.mark.parametrize("kind", ["camera", "distant"])
def test_opengl_projects_as_the_view_does(camera, kind):
    low, high = [-0.2, -0.2, 0.5], [0.2, 0.2, 1.0]
    points = np.random.default_rng(0).uniform(low, high, (20, 3))
    view = camera_view(camera)
    if kind == "distant":
        view = distant_view(np.array([0.2, 1.0, 0.3]), points, 48)
    seen = see_all(points, view)
    clip = np.c_[points, np.ones(20)] @ clip_from_world(view, seen[:, 2]).T
    found = (clip[:, :2] / clip[:, 3:] + 1.0) / 2.0 * [view.width, view.height]
    np.testing.assert_allclose(found, seen[:, :2], atol=1e-6)
    depth = clip[:, 2] / clip[:, 3]
    assert (np.abs(depth) <= 1.0).all()
    assert (np.argsort(depth) == np.argsort(seen[:, 2])).all()


def test_a_light_sees_the_nearest_face_of_the_head(context):
    corner = np.array([[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    both = np.concatenate([corner, corner + [0.0, 0.5, 0.0]])
    solid = Solid(context, 1)
    solid.set_head(Mesh(both, np.array([[0, 1, 2], [3, 4, 5]])))
    view = distant_view(np.array([0.0, 1.0, 0.0]), both, 32)
    texture = solid.depth_from(view)
    depth = np.frombuffer(texture.read(), np.float32).reshape(32, 32)
    hit = depth < 1e20
    assert 0.3 < hit.mean() < 0.6
    np.testing.assert_allclose(depth[hit], -0.5, atol=1e-5)
    solid.release()


def test_without_opengl_a_sentence_says_what_to_install(monkeypatch, bob, camera):
    import moderngl

    def fail(*_, **__):
        raise ValueError("no display")

    monkeypatch.setattr(moderngl, "create_standalone_context", fail)
    with pytest.raises(NoContextError, match="install Mesa's EGL"):
        draw_frames(preview_scene(bob, None), [camera])
    assert issubclass(NoContextError, InputError)


def test_a_driver_that_gives_what_is_asked_for_gives_compute_shaders(monkeypatch):
    import moderngl

    # NVIDIA's does so; a context of OpenGL 3.3 cannot draw hair.
    def as_asked(*, require, **_):
        return SimpleNamespace(version_code=require)

    monkeypatch.setattr(moderngl, "create_standalone_context", as_asked)
    assert open_context().version_code == COMPUTE == 430


def test_an_older_driver_gives_what_it_has(monkeypatch):
    import moderngl

    def old(*, require, **_):
        if require > 410:
            raise ValueError("no such version")
        return SimpleNamespace(version_code=410)

    monkeypatch.setattr(moderngl, "create_standalone_context", old)
    assert open_context().version_code == 410


def test_opengl_is_imported_when_it_is_needed():
    code = "import sys, hairfit.render.gl; print('moderngl' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"


def test_hair_in_other_units_is_as_thick_beside_its_size(bob):
    usual = shown_width(bob)
    assert usual == 0.001
    assert shown_width(np.tile(bob, (3, 1, 1))) == pytest.approx(0.0006)
    assert shown_width(2.0 * bob) == usual
    inches = shown_width(bob / 0.0254)
    size = np.linalg.norm(np.ptp(bob.reshape(-1, 3), axis=0)) / 0.0254
    assert inches == pytest.approx(usual * size / 0.5)
    assert shown_width(np.zeros((0, 8, 3))) == 0.001
    assert shown_width(np.zeros((10_000, 8, 3))) == 0.00018
