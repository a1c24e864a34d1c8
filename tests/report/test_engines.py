"""OpenGL and JAX draw the same picture of the same scene."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from hairfit.render.gl import NoContextError
from hairfit.render.lights import DistantLight, PointLight
from hairfit.render.pigment import PIGMENTS, chiang_look
from hairfit.render.scene import Background, HairLook, Scene
from hairfit.render.shadow_style import ShadowStyle
from hairfit.report.engines import EngineStyle, Shot, draw_shots, open_engine
from hairfit.report.orbit import orbit_camera
from hairfit.types import Mesh

LIGHTS = (
    DistantLight(jnp.array([0.3, 0.8, 0.5]), jnp.array([1.2, 1.1, 1.0])),
    PointLight(jnp.array([-0.6, 0.3, 0.5]), jnp.full(3, 0.3)),
)


@pytest.fixture(scope="module")
def scene():
    """A ball that wears hair which falls to all sides."""
    rng = np.random.default_rng(1)
    way = rng.normal(size=(1500, 1, 3))
    way[..., 1] = np.abs(way[..., 1])
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    t = np.linspace(0.0, 1.0, 16)[None, :, None]
    fall = np.array([0.0, -0.15, 0.0]) * rng.uniform(0.7, 1.0, (1500, 1, 1))
    points = 0.1 * way + 0.03 * t * way + t**1.5 * fall
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    head = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    return Scene(
        points,
        look=HairLook(width=0.0004),
        head=head,
        lights=LIGHTS,
        shadows=ShadowStyle(size=128, slices=32),
        background=Background(colour=None),
    )


def pictures(scene, camera):
    """Return the picture by OpenGL and that by JAX."""
    found = []
    for name in ("gl", "jax"):
        try:
            with open_engine(scene, name, EngineStyle()) as engine:
                shots = [Shot("one", camera)]
                drawn = draw_shots(engine, shots, 1, None, lambda stage, share: None)
                found.append(next(iter(drawn)) / 255.0)
        except NoContextError as error:
            pytest.skip(f"OpenGL is needed here: {error}")
    return found


@pytest.mark.parametrize("look", ["plain", "chiang"])
def test_both_engines_draw_the_same(scene, look):
    if look == "chiang":
        fibres = chiang_look(PIGMENTS["brown"], steps=24, width=0.0004)
        scene = dataclasses.replace(scene, look=fibres)
    camera = orbit_camera(scene.strands, 0.4, 0.2, (96, 96))
    gl, jax = pictures(scene, camera)
    covered = [picture[..., 3] > 0.5 for picture in (gl, jax)]
    assert (covered[0] & covered[1]).sum() >= 0.98 * (covered[0] | covered[1]).sum()
    bare = dataclasses.replace(scene, strands=scene.strands[:1])
    head, _ = pictures(bare, camera)
    hair = covered[0] & covered[1] & (np.abs(gl - head).max(-1) > 0.1)
    assert hair.mean() > 0.1
    bright = [picture[hair, :3].mean() for picture in (gl, jax)]
    assert abs(bright[0] - bright[1]) < 0.05 * bright[0]
    assert np.abs(gl - jax)[hair].mean() < 0.1 * bright[0]
    # The head alone, in the shadow of hair and of itself.
    skin = covered[0] & covered[1] & ~hair
    assert np.abs(gl - jax)[skin].mean() < 0.05


def test_both_engines_hide_hair_behind_the_background(scene):
    camera = orbit_camera(scene.strands, 0.4, 0.2, (96, 96))
    depth = np.full((96, 96), np.inf)
    depth[:, 48:] = 0.1
    picture = np.full((96, 96, 3), 0.25)
    scene = dataclasses.replace(scene, background=Background(None, picture, depth))
    gl, jax = pictures(scene, camera)
    white = 0.537  # sRGB of a quarter of all light
    for drawn in (gl, jax):
        assert np.allclose(drawn[:, 49:, :3], white, atol=0.01)
        assert np.abs(drawn[40:60, 30:44, :3] - white).max() > 0.1
        assert (drawn[..., 3] == 1.0).all()
