"""Pictures by JAX: parts are the whole, and hair is as wide and bright as it is."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render import Camera
from hairfit.render.lights import DistantLight
from hairfit.render.lit import lit_past, rounded_up, solid
from hairfit.render.picture import Pictures, PictureStyle
from hairfit.render.scene import Background, HairLook, Scene
from hairfit.types import Mesh

FLAT = HairLook(width=0.0006, ambient=1.0, variation=0.0, colour=(0.5, 0.25, 0.125))


@pytest.fixture(scope="module")
def camera():
    K = jnp.array([[110.0, 0.0, 40.0], [0.0, 110.0, 32.0], [0.0, 0.0, 1.0]])
    turned = jnp.diag(jnp.array([1.0, -1.0, -1.0, 1.0]))
    return Camera(K, turned.at[2, 3].set(0.5), 80, 64)


def strand(y, width):
    x = np.linspace(-0.1, 0.1, 21)
    points = np.stack([x, np.full(21, y), np.zeros(21)], -1)[None]
    look = dataclasses.replace(FLAT, width=width)
    return Scene(
        points, look=look, sky=(1.0, 1.0, 1.0), background=Background(colour=None)
    )


def test_hair_covers_as_much_as_it_is_wide(camera):
    for pixels in (0.3, 3.0):
        # Its middle is that of a row.
        scene = strand(0.5 * 0.5 / 110.0, pixels * 0.5 / 110.0)
        drawn = Pictures(scene, PictureStyle(layers=8)).draw_linear(camera)
        column = drawn[:, 40]
        assert column[:, 3].sum() == pytest.approx(pixels, rel=0.1)
        share = column[31, :3] / column[31, 3]
        assert np.allclose(share, FLAT.colour, rtol=1e-3)


def test_parts_of_a_picture_are_the_whole(camera):
    rng = np.random.default_rng(0)
    points = rng.normal(0.0, 0.04, (60, 1, 3)) + np.cumsum(
        rng.normal(0.0, 0.008, (60, 9, 3)), 1
    )
    scene = dataclasses.replace(strand(0.0, 0.001), strands=points)
    whole = Pictures(scene, PictureStyle(layers=8)).draw_linear(camera)
    shares = []
    parts = Pictures(scene, PictureStyle(layers=8, longest=33))
    found = parts.draw_linear(camera, shares.append)
    assert np.abs(found - whole)[..., 3].max() < 0.12  # other samples along a segment
    assert np.abs(found - whole).mean() < 0.01
    assert shares == sorted(shares) and len(shares) == 6


def test_a_scene_without_hair_is_its_background(camera):
    empty = dataclasses.replace(
        strand(0.0, 0.001),
        strands=np.zeros((0, 5, 3)),
        background=Background(colour=(0.1, 0.2, 0.3)),
    )
    drawn = Pictures(empty).draw_linear(camera)
    assert np.allclose(drawn, [0.1, 0.2, 0.3, 1.0])


def test_a_wall_keeps_far_light_away():
    wall = Mesh(
        np.array([[-1.0, -1, 0.05], [1, -1, 0.05], [0, 2, 0.05]]), np.array([[0, 1, 2]])
    )
    light = DistantLight(jnp.array([0.0, 0.0, 1.0]), jnp.ones(3))
    # Before it, just under its surface, and behind it.
    places = np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 0.049], [0.0, 0.0, 0.0]])
    assert lit_past(solid(wall), places, light, 0.003).tolist() == [True, True, False]


def test_few_numbers_of_samples_are_used():
    assert [rounded_up(n) for n in (1, 2, 3, 5, 6, 7, 9, 13)] == [
        1,
        2,
        3,
        6,
        6,
        8,
        12,
        16,
    ]
