"""Hair drawn as lines, against closed forms, exact blending and many samples."""

import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.render import Camera
from hairfit.render.gl import lines as gl_lines
from hairfit.render.gl.lines import HairLines, draw_lines, subpixels, supersampled
from hairfit.render.pieces import hair_pieces, strips_needed
from hairfit.render.scene import Background, HairLook, Scene
from hairfit.render.view import camera_view, see_all
from hairfit.render.visibility import composite
from hairfit.types import Mesh

CLEAR = Background(colour=None)


def camera(
    width: int = 96, height: int = 72, turn_deg: float = 0.0, focal: float = 1.1
) -> Camera:
    """A camera 0.6 m before the head, turned around it."""
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    looks = np.array([[c, 0.0, -s], [0.0, -1.0, 0.0], [-s, 0.0, -c]])
    t = -looks @ (np.array([0.0, -0.02, 0.0]) + 0.6 * np.array([s, 0.0, c]))
    f = focal * height
    K = np.array([[f, 0.0, width / 2], [0.0, f, height / 2], [0.0, 0.0, 1.0]])
    pose = np.eye(4)
    pose[:3] = np.concatenate([looks, t[:, None]], 1)
    return Camera(jnp.asarray(K), jnp.asarray(pose), width, height)


def flat_camera(width: int = 16, height: int = 8) -> Camera:
    """A camera along z, of 100 pixels per metre at 1 m; its corner is at x = y = 0."""
    K = jnp.diag(jnp.array([100.0, 100.0, 1.0]))
    return Camera(K, jnp.eye(4), width, height)


def level(x0: float, x1: float, y: float, z: float = 1.0, knots: int = 3) -> np.ndarray:
    """A level strand in pixels of `flat_camera`, at a depth."""
    x = np.linspace(x0, x1, knots)
    at = np.stack([x, np.full(knots, y)], -1) * z / 100.0
    return np.concatenate([at, np.full((knots, 1), z)], -1)[None]


def tinted(strands: np.ndarray) -> np.ndarray:
    """Colours that differ from strand to strand, and from root to tip."""
    tint = np.random.default_rng(0).uniform(0.0, 1.0, (len(strands), 1, 3))
    return tint * np.linspace(0.5, 1.0, strands.shape[1])[:, None]


def scene_of(strands: np.ndarray, width: float, alpha: float = 1.0, **more) -> Scene:
    look = HairLook(width=width, alpha=alpha)
    return Scene(strands, look, **{"background": CLEAR, **more})


def blended_exactly(
    scene: Scene, colours: np.ndarray, cam: Camera, order
) -> np.ndarray:
    """What `composite` makes of a scene without a head."""
    view = camera_view(cam)
    width, segments = scene.look.width, colours.shape[1] - 1
    strips = strips_needed(scene.strands, width, view)
    pieces = hair_pieces(scene.strands, width, view, strips)
    strand, k = pieces.segment // segments, pieces.segment % segments
    t = 0.5 * (pieces.start + pieces.end)[:, None]
    colour = (1.0 - t) * colours[strand, k] + t * colours[strand, k + 1]
    hair = composite(pieces, colour, scene.look.alpha, view, order)
    return np.concatenate([hair.colour, hair.coverage[..., None]], 2)


def psnr(one: np.ndarray, other: np.ndarray) -> float:
    return float(-10.0 * np.log10(np.mean((one - other) ** 2)))


@pytest.mark.parametrize(("width", "alpha"), [(8e-4, 1.0), (8e-4, 0.4), (2e-3, 1.0)])
def test_blended_hair_is_the_exact_blend_in_the_same_order(context, bob, width, alpha):
    scene, colours = scene_of(bob, width, alpha), tinted(bob)
    lines = HairLines(context, scene, colours, bins=64)
    found = lines.blended(camera())
    assert lines.order is not None
    expected = blended_exactly(scene, colours, camera(), lines.order.order)
    assert expected[..., 3].max() > 0.4
    assert np.abs(found - expected).max() < 0.5 / 255.0
    lines.release()


def test_a_wide_hair_is_split_into_strips_that_add_up(context):
    # 2 pixels wide, from x = 2.25 to 9 and y = 2.5 to 4.5, in 4 strips.
    scene = scene_of(level(2.25, 9.0, 3.5), 0.02)
    found = draw_lines(context, scene, np.ones((1, 3, 3)), flat_camera())
    expected = np.zeros((8, 16))
    expected[2:5, 2:9] = np.array([0.5, 1.0, 0.5])[:, None]
    expected[:, 2] *= 0.75
    # In pixel 5 the segments meet, and blend as two hairs would.
    whole = [2, 3, 4, 6, 7, 8]
    np.testing.assert_allclose(found[:, whole, 3], expected[:, whole], atol=1e-5)
    np.testing.assert_array_equal(found[..., 0], found[..., 3])
    assert (np.delete(found, np.s_[2:9], 1) == 0.0).all()


def test_plain_lines_cover_whole_pixels_and_the_nearest_wins(context):
    strands = np.concatenate([level(2, 12, 3.5, 1.0), level(6, 14, 3.5, 2.0)])
    colours = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])[:, None].repeat(3, 1)
    found = draw_lines(
        context, scene_of(strands, 1e-4), colours, flat_camera(), mode="plain"
    )
    assert set(np.unique(found[..., 3])) == {0.0, 1.0}
    assert found[..., 3].sum() == 12 and found[3, 2:14, 3].all()
    assert (found[3, 2:12, 0] == 1.0).all() and (found[3, 12:14, 2] == 1.0).all()


def test_many_samples_see_what_a_wide_strand_covers(context):
    # 1.5 pixels wide: rows 2.75 to 4.25.
    scene = scene_of(level(2.25, 10.5, 3.5), 0.015)
    found = supersampled(context, scene, np.ones((1, 3, 3)), flat_camera(), 16)
    expected = np.zeros((8, 16))
    expected[2:5, 2:11] = np.array([0.25, 1.0, 0.25])[:, None]
    expected[:, 2] *= 0.75
    expected[:, 10] *= 0.5
    np.testing.assert_allclose(found[..., 3], expected, atol=1e-6)


def test_colours_run_evenly_along_a_segment(context):
    scene = scene_of(level(2.0, 12.0, 3.5, knots=2), 0.01)
    colours = np.zeros((1, 2, 3))
    colours[0, 1] = 1.0
    ramp = (np.arange(10) + 0.5) / 10.0
    for mode in ("plain", "blended", "accumulated"):
        found = draw_lines(context, scene, colours, flat_camera(), mode=mode)
        np.testing.assert_allclose(found[3, 2:12, 1], ramp, atol=1e-5)


def test_large_pictures_are_drawn_by_tiles(context, bob, monkeypatch):
    scene, colours = scene_of(bob, 2e-3), tinted(bob)
    whole = supersampled(context, scene, colours, camera(), 4)
    monkeypatch.setattr(gl_lines, "LONGEST", 4 * 40)
    parts = supersampled(context, scene, colours, camera(), 4)
    # A sample on an edge may fall to either side.
    assert psnr(whole, parts) > 50.0


def test_accumulated_pictures_come_closer_to_the_truth_with_their_number(context, bob):
    scene, colours = scene_of(bob, 8e-4), tinted(bob)
    lines = HairLines(context, scene, colours)
    truth = lines.supersampled(camera(), 32)
    found = [psnr(lines.accumulated(camera(), n), truth) for n in (1, 4, 16, 64)]
    assert (np.diff(found) > 4.0).all()
    assert found[-1] > 40.0
    lines.release()


def test_subpixels_fill_the_pixel_evenly():
    for count in (1, 4, 16, 37):
        at = subpixels(count)
        assert at.shape == (count, 2) and (at > 0.0).all() and (at < 1.0).all()
        np.testing.assert_allclose(at.mean(0), 0.5, atol=1.2 / count)
        # As many in each column as in each row: one.
        assert sorted(np.floor(at[:, 0] * count)) == list(range(count))
    assert sorted(np.floor(subpixels(16)[:, 1] * 16)) == list(range(16))


@pytest.fixture(scope="module")
def dense():
    """A bob of 4 000 strands that fills the picture."""
    rng = np.random.default_rng(3)
    way = rng.normal(size=(4000, 1, 3))
    way[..., 1] = np.abs(way[..., 1])
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    t = np.linspace(0.0, 1.0, 33)[None, :, None]
    fall = np.array([0.0, -0.2, 0.0]) * rng.uniform(0.6, 1.0, (4000, 1, 1))
    wave = 0.004 * np.sin(20.0 * t + rng.uniform(0.0, 6.0, (4000, 1, 1)))
    strands = 0.1 * way + 0.05 * t * way + t**1.5 * fall
    return strands + wave * rng.normal(size=(4000, 1, 3))


def test_blended_hair_is_near_the_truth_and_plain_lines_are_not(context, dense):
    cam = camera(160, 120, focal=1.8)
    # Brown hair of a tenth of a pixel, before a bright wall.
    scene = scene_of(dense, 3e-4, background=Background((0.8, 0.8, 0.8)))
    bright = np.exp(0.3 * np.random.default_rng(0).standard_normal((4000, 1, 1)))
    colours = np.broadcast_to(2.0 * bright * HairLook().colour, dense.shape)
    seen = see_all(dense, camera_view(cam))
    assert 0.1 < 3e-4 * seen[..., 3].mean() < 0.12
    lines = HairLines(context, scene, colours)
    truth = lines.supersampled(cam, 16)
    assert (truth[..., 2] < 0.4).mean() > 0.3  # mostly hair
    blended, plain = psnr(lines.blended(cam), truth), psnr(lines.plain(cam), truth)
    assert blended > 35.0
    assert blended > plain + 6.0
    lines.release()


def test_more_bins_come_closer_to_sorting_every_pixel(context, bob):
    scene, colours = scene_of(bob, 2e-3), tinted(bob)
    exact = blended_exactly(scene, colours, camera(), None)
    found = [
        psnr(draw_lines(context, scene, colours, camera(), bins=bins), exact)
        for bins in (1, 8, 512)
    ]
    assert found[0] + 3.0 < found[1] and found[1] + 3.0 < found[2]


def test_an_order_is_kept_until_the_view_has_turned(context, bob):
    scene, colours = scene_of(bob, 2e-3), tinted(bob)
    lines = HairLines(context, scene, colours, turn_deg=20.0)
    for turn, expected in ((0, 1), (10, 1), (19, 1), (21, 2), (40, 2), (0, 3)):
        lines.blended(camera(turn_deg=turn))
        assert lines.sorted == expected
    old = lines.blended(camera(turn_deg=19.9))
    lines.turn_deg = 0.0
    new = lines.blended(camera(turn_deg=19.9))
    assert lines.sorted == 4
    lines.blended(camera(turn_deg=19.9))
    assert lines.sorted == 4  # the view is the same
    # Figure 6-15: an old order is not seen, but it is another one.
    assert 35.0 < psnr(old, new) < 100.0
    np.testing.assert_allclose(old[..., 3], new[..., 3], atol=1e-5)
    lines.release()


def test_a_head_hides_the_hair_behind_it(context):
    corner = np.array([[-1.0, -1, 1.5], [0.12, -1, 1.5], [0.12, 1, 1.5], [-1, 1, 1.5]])
    head = Mesh(corner, np.array([[0, 1, 2], [0, 2, 3]]))  # to x = 8 pixels
    strands = np.concatenate([level(2, 14, 2.5, 1.0), level(2, 14, 5.5, 2.0)])
    scene = scene_of(strands, 0.004, head=head, skin=(0.0, 1.0, 0.0))
    red = np.tile([1.0, 0.0, 0.0], (2, 3, 1))
    lines = HairLines(context, scene, red)
    cam = flat_camera()
    pictures = [lines.plain(cam), lines.blended(cam), lines.accumulated(cam, 16)]
    for found in (*pictures, lines.supersampled(cam, 8)):
        assert (found[2, 2:14, 0] > 0.3).all()  # before the head
        assert (found[5, :8, 0] == 0.0).all()  # behind it
        assert (found[5, 9:14, 0] > 0.1).all()  # beside it
        np.testing.assert_allclose(found[5, :7], [0.0, 1.0, 0.0, 1.0] * np.ones((7, 1)))
    lines.set_head_colours(np.tile([0.0, 0.0, 0.5], (4, 1)))
    np.testing.assert_allclose(lines.blended(cam)[0, 3], [0.0, 0.0, 0.5, 1.0])
    lines.release()


def test_hair_blends_with_a_background_that_may_hide_it(context):
    depth = np.full((8, 16), np.inf)
    depth[:, :6] = 0.5
    back = Background(picture=np.full((8, 16, 3), 0.25), depth=depth)
    scene = scene_of(level(2, 14, 2.5), 0.004, 0.5, background=back)
    found = draw_lines(context, scene, np.ones((1, 3, 3)), flat_camera())
    np.testing.assert_allclose(found[2, :6], [0.25, 0.25, 0.25, 1.0] * np.ones((6, 1)))
    share = 0.4 * 0.5
    np.testing.assert_allclose(found[2, 9, :3], share + (1 - share) * 0.25, atol=1e-6)
    np.testing.assert_allclose(found[..., 3], 1.0, atol=1e-6)


def test_hair_that_reaches_behind_the_eye_is_left_out(context):
    strand = np.array([[[0.05, 0.03, z] for z in (-1.0, -0.5, 0.5, 1.0)]])
    strand[..., 0] += np.linspace(0.0, 0.01, 4)
    scene = scene_of(strand, 0.004)
    lines = HairLines(context, scene, np.ones((1, 4, 3)))
    expected = supersampled(
        context, scene_of(strand[:, 2:], 0.004), np.ones((1, 2, 3)), flat_camera()
    )
    found = lines.supersampled(flat_camera())
    assert expected[..., 3].sum() > 0.5
    np.testing.assert_array_equal(found, expected)
    assert lines.blended(flat_camera())[..., 3].sum() > 0.5
    lines.release()


def test_a_scene_without_hair_is_its_background(context):
    scene = scene_of(np.zeros((0, 3, 3)), 0.01, background=Background((0.5, 0.5, 0.5)))
    lines = HairLines(context, scene, np.zeros((0, 3, 3)))
    cam = flat_camera()
    for found in (lines.plain(cam), lines.blended(cam), lines.supersampled(cam, 2)):
        np.testing.assert_allclose(found, [0.5, 0.5, 0.5, 1.0] * np.ones((8, 16, 1)))
    lines.release()


def test_colours_of_another_shape_are_refused(context, bob):
    with pytest.raises(ValueError, match="a colour for each vertex, got colours of"):
        HairLines(context, scene_of(bob, 1e-3), np.ones((300, 16, 3)))
