import subprocess
import sys

import jax.numpy as jnp
import numpy as np
import pytest

from hairfit import InputError
from hairfit.render import Camera, rasterise
from hairfit.render.gl import NoContextError, PreviewStyle, render_preview, turntable
from hairfit.render.gl.context import open_context
from hairfit.render.gl.preview import clip_from_world
from hairfit.types import Mesh

FOCAL, WIDTH, HEIGHT = 100.0, 64, 48
PLAIN = PreviewStyle(background=(0.0, 0.0, 0.0), width_px=1.5)


@pytest.fixture(scope="module")
def gl():
    try:
        open_context().release()
    except NoContextError as error:
        pytest.skip(f"OpenGL is needed here: {error}")


@pytest.fixture
def camera():
    K = jnp.array([[FOCAL, 0.0, 30.0], [0.0, FOCAL, 20.0], [0.0, 0.0, 1.0]])
    return Camera(K, jnp.eye(4), WIDTH, HEIGHT)


def level_strands(y, z, count=1):
    x = np.linspace(-0.15, 0.15, 8)
    rows = np.linspace(0.0, 0.01, count)
    strand = np.stack([np.broadcast_to(x, (count, 8)), np.zeros((count, 8))], -1)
    strand = np.concatenate([strand, np.full((count, 8, 1), z)], -1)
    strand[..., 1] = y + rows[:, None]
    return strand


def square(z, half):
    corner = np.array([[-half, -half, z], [half, -half, z], [half, half, z]])
    corner = np.concatenate([corner, [[-half, half, z]]])
    return Mesh(corner, np.array([[0, 2, 1], [0, 3, 2]]))


def test_hair_lands_where_the_raster_has_it(gl, camera):
    strands = level_strands(0.055, 1.0)
    picture = render_preview(strands, None, camera, style=PLAIN)
    assert picture.shape == (HEIGHT, WIDTH, 3) and picture.dtype == np.uint8
    bright = picture.sum(-1).astype(float)
    assert set(np.flatnonzero(bright.max(1) > 60)) <= {24, 25, 26}
    row, column = np.nonzero(rasterise(strands, camera).coverage[:, 15:45])
    assert (bright[row, column + 15] > 60).all()
    covered = np.flatnonzero(bright.max(0) > 60)
    assert covered.min() in (14, 15) and covered.max() in (44, 45)


def test_the_head_hides_hair_behind_it_and_none_before_it(gl, camera):
    head = square(1.0, 0.1)
    style = PreviewStyle(hair=(0.0, 1.0, 0.0), head=(1.0, 0.0, 0.0), width_px=3.0)
    behind = render_preview(level_strands(0.0, 1.2), head, camera, style=style)
    before = render_preview(level_strands(0.0, 0.8), head, camera, style=style)
    assert behind[20, 30, 0] > behind[20, 30, 1]
    assert before[20, 30, 1] > before[20, 30, 0]


def test_hair_throws_shadows_on_hair(gl, camera):
    low = level_strands(0.0, 1.0, 60)
    rng = np.random.default_rng(0)
    # Above it, where the light comes from.
    place = rng.uniform([0.0, -0.20, 0.80], [0.0, -0.05, 0.95], (700, 3))
    high = level_strands(0.0, 0.0, 1) + place[:, None]
    # The number of strands says how much hair each stands for: keep it.
    aside = np.concatenate([low, high + [5.0, 0.0, 0.0]])
    above = np.concatenate([low, high])
    lit = render_preview(aside, None, camera, style=PLAIN)[20:22, 20:40].mean()
    dark = render_preview(above, None, camera, style=PLAIN)[20:22, 20:40].mean()
    assert dark < 0.8 * lit


def test_a_turntable_has_a_frame_for_each_camera_and_is_the_same_each_time(gl, camera):
    strands = level_strands(0.0, 1.0, 5)
    first = turntable(strands, square(1.2, 0.2), [camera, camera])
    again = render_preview(strands, square(1.2, 0.2), camera)
    assert len(first) == 2
    assert np.array_equal(first[0], first[1])
    assert np.array_equal(first[0], again)


def test_no_hair_gives_a_picture_of_the_background(gl, camera):
    picture = render_preview(np.zeros((0, 8, 3)), None, camera)
    assert (picture == picture[0, 0]).all()


def test_the_projection_is_the_cameras(camera):
    strands = level_strands(0.03, 1.1)
    clip = clip_from_world(camera, strands, None)
    p = strands[0, 3]
    x, y, z, w = clip @ [*p, 1.0]
    expected = camera.project(jnp.asarray(p))
    found = (np.array([x, y]) / w + 1.0) / 2.0 * [WIDTH, HEIGHT]
    assert np.allclose(found, expected.pixel)
    assert w == pytest.approx(1.1)
    assert -1.0 <= z / w <= 1.0


def test_without_opengl_a_sentence_says_what_to_install(monkeypatch, camera):
    import moderngl

    def fail(*_, **__):
        raise ValueError("no display")

    monkeypatch.setattr(moderngl, "create_standalone_context", fail)
    with pytest.raises(NoContextError, match="install Mesa's EGL"):
        render_preview(level_strands(0.0, 1.0), None, camera)
    assert issubclass(NoContextError, InputError)


def test_opengl_is_imported_when_it_is_needed():
    code = "import sys, hairfit.render.gl; print('moderngl' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "False"
