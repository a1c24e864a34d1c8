"""Frames of hair by compute shaders, against the exact reference and JAX."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render import Camera, Fibre, kajiya_kay
from hairfit.render.gl import frame
from hairfit.render.gl.context import NoContextError
from hairfit.render.gl.frame import Frames
from hairfit.render.gl.pixels import FrameStyle
from hairfit.render.lights import DistantLight, PointLight
from hairfit.render.phase import phase_angles
from hairfit.render.phase_table import phase_table
from hairfit.render.pieces import hair_pieces
from hairfit.render.scene import Background, HairLook, Scene
from hairfit.render.shadow_style import ShadowStyle
from hairfit.render.view import camera_view
from hairfit.render.visibility import composite
from hairfit.types import Mesh

# Sends back what it gets from the sky, whatever its direction.
FLAT = HairLook(width=0.0006, ambient=1.0, variation=0.0)
WHITE = (1.0, 1.0, 1.0)
BLACK = Background(colour=None)
NEAR_EXACT = FrameStyle(deep=48)


@pytest.fixture(scope="module")
def camera():
    K = jnp.array([[110.0, 0.0, 48.0], [0.0, 110.0, 40.0], [0.0, 0.0, 1.0]])
    turned = jnp.diag(jnp.array([1.0, -1.0, -1.0, 1.0]))
    pose = turned.at[1, 3].set(-0.02).at[2, 3].set(0.5)
    return Camera(K, pose, 96, 80)


def drawn(context, scene, camera, style=NEAR_EXACT):
    frames = Frames(context, scene, style)
    out = frames.draw_linear(camera)
    frames.release()
    return out


def flat_scene(strands, **more):
    tint = np.random.default_rng(2).uniform(0.05, 0.9, (len(strands), 3))
    scene = Scene(strands, look=FLAT, tint=tint, sky=WHITE, background=BLACK)
    return dataclasses.replace(scene, **more)


def test_pixels_are_what_exact_blending_gives(context, bob, camera):
    scene = flat_scene(bob)
    got = drawn(context, scene, camera)
    view = camera_view(camera)
    pieces = hair_pieces(bob.astype(np.float32).astype(np.float64), 0.0006, view)
    strand = pieces.segment // (bob.shape[1] - 1)
    expected = composite(pieces, scene.tints[strand, :3], 1.0, view)
    assert expected.coverage.max() > 0.8
    assert np.abs(got[..., 3] - expected.coverage).max() < 2.0 / 255.0
    error = got[..., :3] - expected.colour
    assert 10.0 * np.log10(1.0 / (error**2).mean()) > 50.0


def test_few_layers_are_nearly_as_good_as_all(context, bob, camera):
    scene = flat_scene(bob)
    exact = drawn(context, scene, camera)
    few = drawn(context, scene, camera, FrameStyle(deep=8))
    np.testing.assert_allclose(few[..., 3], exact[..., 3], atol=2e-3)
    assert 10.0 * np.log10(1.0 / ((few - exact) ** 2).mean()) > 40.0


def test_hair_at_one_depth_looks_the_same_in_whatever_order_it_is_given(
    context, camera
):
    rng = np.random.default_rng(3)
    ends = rng.uniform(-0.1, 0.1, (30, 2, 1, 3)) * [1.0, 1.0, 0.0]
    t = np.linspace(0.0, 1.0, 9)[None, :, None]
    strands = (1 - t) * ends[:, 0] + t * ends[:, 1]
    scene = flat_scene(strands)
    assert scene.tint is not None
    turned = dataclasses.replace(scene, strands=strands[::-1], tint=scene.tint[::-1])
    one, other = (drawn(context, each, camera) for each in (scene, turned))
    assert one[..., 3].max() > 0.3
    np.testing.assert_array_equal(one, other)


def test_parts_of_a_picture_are_the_whole(context, bob, camera, monkeypatch):
    scene = flat_scene(bob)
    frames = Frames(context, scene, NEAR_EXACT)
    whole = frames.draw_linear(camera)
    monkeypatch.setattr(frame, "LONGEST", 33)
    np.testing.assert_allclose(frames.draw_linear(camera), whole, atol=2e-3)
    frames.pixels.most_pieces = 1500
    frames.pixels.buffers.release()
    np.testing.assert_allclose(frames.draw_linear(camera), whole, atol=2e-3)
    frames.release()


def test_light_is_computed_once_for_many_cameras(context, bob, camera):
    light = DistantLight(jnp.array([0.0, 1.0, 0.0]), jnp.ones(3))
    scene = Scene(bob, lights=(light,), shadows=ShadowStyle(size=64, slices=8))
    frames = Frames(context, scene)
    first = frames.draw(camera)
    np.testing.assert_array_equal(frames.draw(camera), first)
    assert frames.relit == 1
    frames.release()


@pytest.mark.parametrize("kind", ["distant", "lamp"])
def test_a_lone_strand_shines_as_kajiya_and_kay_say(context, camera, kind):
    x = np.linspace(-0.1, 0.1, 81)
    strand = np.stack([x, np.full(81, 0.02), np.zeros(81)], -1)
    place = np.array([0.3, 0.5, 0.4])
    light = (
        DistantLight(jnp.asarray(place / np.linalg.norm(place)), jnp.ones(3))
        if kind == "distant"
        else PointLight(jnp.asarray(place), jnp.full(3, 0.5))
    )
    look = HairLook(width=0.004, variation=0.0, shininess=9.0, coloured=0.0)
    scene = Scene(strand[None], look=look, lights=(light,), shadows=None)
    got = drawn(context, dataclasses.replace(scene, background=BLACK), camera)
    own = jnp.asarray(look.colour)
    fibre = Fibre(
        jnp.zeros(3), look.diffuse * own, jnp.asarray(look.specular), jnp.asarray(9.0)
    )
    p = jnp.array([0.5 * 0.5 / 110.0, 0.02, 0.0])  # the middle of column 48
    way = light.to_light if isinstance(light, DistantLight) else jnp.asarray(place) - p
    to_eye = camera.centre - p
    expected = kajiya_kay(
        jnp.array([1.0, 0.0, 0.0]),
        way / jnp.linalg.norm(way),
        to_eye / jnp.linalg.norm(to_eye),
        fibre,
    )
    if kind == "lamp":
        expected = 0.5 * expected / jnp.sum(way**2)
    expected = expected + look.ambient * own * 0.3
    column, row = np.asarray(camera.project(p).pixel).astype(int)
    pixel = got[row, column]
    assert pixel[3] > 0.3
    np.testing.assert_allclose(pixel[:3] / pixel[3], expected, rtol=0.02)


def square(z, half):
    corner = np.array([[-half, -half, z], [half, -half, z], [half, half, z]])
    corner = np.concatenate([corner, [[-half, half, z]]])
    return Mesh(corner, np.array([[0, 2, 1], [0, 3, 2]]))


def test_a_head_hides_what_is_behind_it_and_hair_darkens_it(context, bob, camera):
    light = DistantLight(jnp.array([0.0, 0.0, 1.0]), jnp.ones(3))
    scene = flat_scene(bob, lights=(light,), skin=(0.0, 0.0, 1.0), head=square(0.3, 1))
    hidden = drawn(context, scene, camera)
    assert (hidden[..., :2] == 0.0).all()
    np.testing.assert_allclose(hidden[..., 3], 1.0, atol=1e-6)
    behind = dataclasses.replace(scene, head=square(-0.3, 1.0))
    seen = drawn(context, behind, camera)
    assert (seen[..., 0] > 0.05).any()


def test_hair_lies_between_the_parts_of_a_picture_with_depth(context, bob, camera):
    picture = np.zeros((80, 96, 3))
    picture[..., 2] = 1.0
    depth = np.full((80, 96), np.inf)
    depth[:, :48] = 0.1
    scene = flat_scene(bob, background=Background(picture=picture, depth=depth))
    out = drawn(context, scene, camera)
    assert (out[:, :48, 0] == 0.0).all()
    assert out[:, 48:, 0].max() > 0.1
    np.testing.assert_allclose(out[..., 3], 1.0, atol=1e-6)


def test_wide_hair_is_opaque_in_its_middle(context, camera):
    strand = np.stack([np.linspace(-0.1, 0.1, 9), np.full(9, 0.02), np.zeros(9)], -1)
    look = dataclasses.replace(FLAT, width=0.02)
    scene = flat_scene(strand[None], look=look)
    out = drawn(context, scene, camera)
    rows = np.flatnonzero(out[:, 48, 3] > 0.95)
    assert len(rows) >= 3  # 0.02 m are 4.4 pixels
    total = out[:, 48, 3].sum()
    assert total == pytest.approx(0.02 * 110.0 / 0.5, rel=0.03)


def test_no_hair_is_the_background(context, camera):
    frames = Frames(context, Scene(np.zeros((0, 8, 3))))
    picture = frames.draw(camera)
    assert (picture == picture[0, 0]).all()
    assert picture[0, 0, 3] == 255
    frames.release()


def test_an_old_opengl_is_refused_with_what_to_do(bob):
    class Old:
        version_code = 330

    with pytest.raises(NoContextError, match="version 3.3, and compute .* need 4.3"):
        Frames(Old(), Scene(bob))


def test_more_lights_than_shaders_take_are_refused(bob):
    light = DistantLight(jnp.array([0.0, 1.0, 0.0]), jnp.ones(3))
    with pytest.raises(ValueError, match="at most 16 lights, got 17"):
        Scene(bob, lights=(light,) * 17)


def test_a_table_shines_as_the_function_that_it_holds(context, camera):
    def phase(angles):
        theta, theta_eye, phi = angles
        lobe = jnp.exp(-2.0 * (theta - 0.5 * theta_eye) ** 2) + 0.2 * theta_eye
        return lobe * jnp.array([1.0, 0.5, 0.2]) * (1.2 + jnp.cos(phi - 0.5))

    table = phase_table(phase, 96, 48)
    x = np.linspace(-0.1, 0.1, 81)
    strand = np.stack([x, np.full(81, 0.02), np.zeros(81)], -1)
    look = HairLook(width=0.004, variation=0.0, diffuse=0.0, ambient=0.0, table=table)
    p = jnp.array([0.5 * 0.5 / 110.0, 0.02, 0.0])
    to_eye = camera.centre - p
    to_eye = to_eye / jnp.linalg.norm(to_eye)
    column, row = np.asarray(camera.project(p).pixel).astype(int)
    for way in ([0.2, 0.9, 0.3], [-0.4, 0.1, -0.9]):
        to_light = jnp.asarray(way) / jnp.linalg.norm(jnp.asarray(way))
        light = DistantLight(to_light, jnp.ones(3))
        scene = Scene(strand[None], look=look, lights=(light,), shadows=None)
        got = drawn(context, dataclasses.replace(scene, background=BLACK), camera)
        angles = phase_angles(jnp.array([1.0, 0.0, 0.0]), to_light, to_eye)
        expected = np.pi * jnp.cos(angles.theta) * phase(angles)
        pixel = got[row, column]
        np.testing.assert_allclose(pixel[:3] / pixel[3], expected, rtol=0.01)


def test_small_pixels_are_averaged_to_the_same_picture_but_finer(context, bob, camera):
    picture = np.full((80, 96, 3), 0.5)
    scene = flat_scene(bob, background=Background(picture=picture))
    coarse = drawn(context, scene, camera)
    fine = drawn(context, scene, camera, FrameStyle(deep=48, fine=3))
    assert fine.shape == coarse.shape
    assert np.abs(fine - coarse).mean() < 0.01
    assert 25.0 < -10.0 * np.log10(((fine - coarse) ** 2).mean()) < 60.0
    frames = Frames(context, scene, FrameStyle(fine=2, white=4.0))
    small = frames.draw(camera)
    frames.release()
    frames = Frames(context, scene, FrameStyle(white=4.0))
    direct = frames.draw(camera)
    frames.release()
    assert np.abs(small.astype(int) - direct).mean() < 3.0
    np.testing.assert_array_equal(small[0, 0], direct[0, 0])
