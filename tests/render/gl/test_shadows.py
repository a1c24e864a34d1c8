"""Opacity shadow maps by compute shaders, against the float64 reference."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh

from hairfit.render.gl.buffers import point_rows
from hairfit.render.gl.context import read
from hairfit.render.gl.cover import Cover
from hairfit.render.gl.frame import Frames
from hairfit.render.gl.shadows import ShadowMaps
from hairfit.render.gl.solid import Solid
from hairfit.render.lights import DistantLight
from hairfit.render.opacity_layers import Range, hair_range
from hairfit.render.opacity_lookup import opacity_at
from hairfit.render.opacity_maps import opacity_maps
from hairfit.render.opacity_occupied import SLABS, occupied_maps, within
from hairfit.render.pieces import hair_pieces
from hairfit.render.scene import HairLook, Scene
from hairfit.render.shadow_style import ShadowStyle
from hairfit.render.slices import uniform_slices
from hairfit.render.view import distant_view, lamp_view, see_all
from hairfit.types import Mesh

WIDTH = 0.0008
TO_LIGHT = np.array([0.3, 0.8, 0.5])


class Lit:
    """Maps of a scene, and what they let through to the strands' vertices."""

    def __init__(self, context, strands, view, style, known=None, head=None):
        self.flat = strands.astype(np.float32).astype(np.float64).reshape(-1, 3)
        count = len(self.flat)
        points = context.buffer(point_rows(strands, WIDTH))
        out = context.buffer(reserve=8 * count)
        maps = ShadowMaps(context, style)
        depth = see_all(self.flat, view)[:, 2]
        maps.build(points, count, view, depth, known)
        maps.light(points, count, out, head=head)
        self.opacity, self.past_head = read(out, np.float32, (count, 2)).T
        self.slices = style.depths(depth)
        self.bytes, self.memory = out.read(), maps.memory
        self.cells = maps.opacity()
        self.occupied = maps.occupied() if maps.adaptive else None
        for thing in (points, out, maps):
            thing.release()


def a_view(kind, strands, size):
    flat = strands.reshape(-1, 3)
    if kind == "lamp":
        return lamp_view(np.array([0.3, 0.5, 0.4]), flat, size)
    return distant_view(TO_LIGHT, flat, size)


@pytest.mark.parametrize("kind", ["distant", "lamp"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"filter": "box3"},
        {"slices": 12, "interpolation": "cubic"},
        {"scheme": "density", "slices": 20},
        {"scheme": "gamma", "slices": 20},
        {"scheme": "adaptive", "slices": 8},
    ],
    ids=str,
)
def test_transmittance_is_the_references_to_a_grey_level(context, bob, kind, options):
    style = ShadowStyle(size=96, **{"slices": 32, **options})
    view = a_view(kind, bob, style.size)
    lit = Lit(context, bob, view, style)
    strands = lit.flat.reshape(bob.shape)
    if style.scheme == "adaptive":
        ends = float(lit.slices[0]), float(lit.slices[-1])
        maps = occupied_maps(
            strands, WIDTH, view, ends, style.slices, occupied=lit.occupied
        )
    else:
        maps = opacity_maps(strands, WIDTH, view, lit.slices)
    expected = opacity_at(
        maps, lit.flat, filter=style.filter, interpolation=style.interpolation
    )
    assert expected.max() > 0.8
    error = np.abs(np.exp(-lit.opacity) - np.exp(-expected)).max()
    assert error < 1.0 / 255.0


def test_the_same_bits_come_out_every_time(context, bob):
    style = ShadowStyle(size=96, slices=32)
    view = a_view("distant", bob, style.size)
    runs = {Lit(context, bob, view, style).bytes for _ in range(10)}
    assert len(runs) == 1


def test_a_known_range_gives_the_layers_that_the_reference_makes_of_it(context, bob):
    style = ShadowStyle(size=64, slices=8, scheme="adaptive")
    view = a_view("distant", bob, style.size)
    own = hair_range(hair_pieces(bob, WIDTH, view), view)
    # As cylinders around the hair would say: a little before it, and behind it.
    known = Range(own.near - 0.01, own.far + 0.02)
    lit = Lit(context, bob, view, style, known)
    ends = float(lit.slices[0]), float(lit.slices[-1])
    held = within(known, uniform_slices(*ends, SLABS))
    np.testing.assert_array_equal(lit.occupied, held)
    maps = occupied_maps(bob, WIDTH, view, ends, style.slices, occupied=held)
    filled = np.isfinite(own.near)
    np.testing.assert_allclose(lit.cells[:, filled], maps.opacity[:, filled], atol=2e-3)


def test_slabs_are_occupied_where_hair_is(context, bob):
    style = ShadowStyle(size=64, slices=8, scheme="adaptive")
    view = a_view("distant", bob, style.size)
    lit = Lit(context, bob, view, style)
    ends = float(lit.slices[0]), float(lit.slices[-1])
    strands = lit.flat.reshape(bob.shape)
    expected = occupied_maps(strands, WIDTH, view, ends, 8).occupied
    assert lit.occupied is not None and expected.sum() > 5000
    # Rounding may find hair that just touches a slab in it, or not.
    assert (lit.occupied != expected).sum() < 2e-3 * expected.sum()


def test_layers_need_less_memory_than_maps(context, bob):
    view = a_view("distant", bob, 64)
    even = Lit(context, bob, view, ShadowStyle(size=64, slices=64))
    layers = Lit(context, bob, view, ShadowStyle(64, 16, "adaptive"))
    assert layers.memory <= 0.3 * even.memory


def test_hair_beside_the_maps_and_behind_the_lamp_is_left_out(context):
    x = np.linspace(-0.5, 0.5, 9)
    strand = np.stack([x, 0.0 * x, np.linspace(-0.5, 1.0, 9)], -1)[None]
    view = lamp_view(np.zeros(3), np.array([[0.0, 0.0, 1.0], [0.1, 0.1, 1.1]]), 32)
    lit = Lit(context, strand, view, ShadowStyle(size=32, slices=4))
    pieces = hair_pieces(strand, WIDTH, view)
    assert lit.cells[-1].sum() == pytest.approx(pieces.area.sum(), rel=1e-4)
    behind = lit.flat[:, 2] <= 0.0
    assert (lit.opacity[behind] == 0.0).all()


def test_a_head_hides_the_light_from_what_lies_behind_it(context):
    corner = np.array([[-0.05, 0.0, -0.05], [0.05, 0, -0.05], [0.05, 0, 0.05]])
    square = np.concatenate([corner, [[-0.05, 0.0, 0.05]]])
    head = Mesh(square, np.array([[0, 1, 2], [0, 2, 3]]))
    solid = Solid(context, 1)
    solid.set_head(head)
    x = np.linspace(-0.1, 0.1, 21)
    heights = np.array([0.05, 0.001, -0.002, -0.05])[:, None]
    strands = np.stack(np.broadcast_arrays(x, heights, 0.013), -1)
    view = distant_view(np.array([0.0, 1.0, 0.0]), strands.reshape(-1, 3), 64)
    style = ShadowStyle(size=64, slices=4, bias=0.003)
    lit = Lit(context, strands, view, style, head=solid.depth_from(view))
    share = lit.past_head.reshape(4, 21)
    inside = np.abs(x) < 0.045
    assert (share[:3] == 1.0).all()  # above it, and within the bias below
    assert (share[3, inside] == 0.0).all()
    assert (share[3, np.abs(x) > 0.055] == 1.0).all()
    solid.release()


def test_styles_without_maps_are_refused():
    with pytest.raises(ValueError, match="at least 8 texels a side, 1 slice"):
        ShadowStyle(slices=0)


def test_a_surface_around_hair_says_where_it_can_be(context):
    ball = trimesh.creation.icosphere(4, 0.1)
    surface = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    cover = Cover(context, surface)
    view = distant_view(np.array([0.0, 0.0, 1.0]), surface.vertices, 64)
    near, far = cover.range(view)
    cover.release()
    scale = float(view.pixels_per_metre)
    place = (np.arange(64) + 0.5 - 32.0) / scale
    square = 0.1**2 - place[:, None] ** 2 - place[None] ** 2
    inside, outside = square > 3e-4, square < -3e-4
    half = np.sqrt(np.maximum(square, 0.0))
    # Depth runs away from the light, which is at +z.
    np.testing.assert_allclose(near[inside], -half[inside], atol=1e-3)
    np.testing.assert_allclose(far[inside], half[inside], atol=1e-3)
    assert (near[outside] == np.inf).all() and (far[outside] == -np.inf).all()


def test_frames_take_the_range_of_a_cover(context, bob):
    light = DistantLight(jnp.asarray(TO_LIGHT), jnp.ones(3))
    style = ShadowStyle(size=64, slices=16, scheme="adaptive")
    centre = bob.reshape(-1, 3).mean(0)
    ball = trimesh.creation.icosphere(3, 0.3)
    ball.apply_translation(centre)
    cover = Mesh(np.asarray(ball.vertices), np.asarray(ball.faces))
    scene = Scene(bob, look=HairLook(width=WIDTH), lights=(light,), shadows=style)
    found = []
    for one in (None, cover):
        frames = Frames(context, dataclasses.replace(scene, cover=one))
        found.append(read(frames.buffers["light"], np.float32, (bob.size // 3, 2)))
        frames.release()
    light = np.exp(-np.stack(found)[..., 0])
    assert 0.0 < np.sqrt(((light[0] - light[1]) ** 2).mean()) < 0.1
