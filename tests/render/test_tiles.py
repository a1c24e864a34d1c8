"""Parts of pictures."""

import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render import Camera
from hairfit.render.scene import Background
from hairfit.render.tiles import Tile, background_of, camera_of, halves, tiles


@pytest.mark.parametrize("size", [(10, 7), (8, 8), (3, 20)])
def test_tiles_cover_every_pixel_once(size):
    width, height = size
    count = np.zeros((height, width), int)
    for tile in tiles(width, height, 4):
        assert max(tile.width, tile.height) <= 4
        for half in halves(tile) if tile.width * tile.height > 1 else (tile,):
            count[half.slices] += 1
    assert (count == 1).all()


def test_a_tiles_camera_sees_what_the_camera_sees_there():
    K = jnp.array([[100.0, 0.0, 31.0], [0.0, 90.0, 22.0], [0.0, 0.0, 1.0]])
    camera = Camera(K, jnp.eye(4), 64, 48)
    p = jnp.array([0.02, -0.01, 1.0])
    part = camera_of(Tile(10, 5, 20, 20), camera)
    shift = camera.project(p).pixel - part.project(p).pixel
    np.testing.assert_allclose(shift, [10.0, 5.0])
    assert (part.width, part.height) == (20, 20)


def test_a_tiles_background_is_that_part_of_it():
    picture = np.arange(60.0).reshape(4, 5, 3)
    part = background_of(Tile(1, 2, 3, 2), Background(picture=picture))
    assert part.picture is not None
    np.testing.assert_array_equal(part.picture, picture[2:4, 1:4])
    assert part.depth is None


def test_a_pixel_is_not_halved():
    with pytest.raises(ValueError, match="no halves"):
        halves(Tile(0, 0, 1, 1))
