import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import (
    DISTANCE,
    FOCAL,
    HEIGHT,
    WIDTH,
    camera_at,
    comb,
    every_root,
    hair_of,
    no_hair,
    photograph,
    ring,
    texels_at,
    view_of,
)

from hairfit.evaluate.visibility import Sight
from hairfit.fit.density import TEXELS
from hairfit.fit.strays import (
    FORWARD,
    FREE,
    LOOP,
    LOST,
    MOST_LOST,
    SEEN_OUT,
    SPARSEST,
    TURN,
    comes_forward,
    comes_out,
    hides_bare,
    without_strays,
)
from hairfit.model.maps import even_maps
from hairfit.model.strand import Hair

EVEN = even_maps(TEXELS, TEXELS)
CAMERA = camera_at([0.0, 0.0, DISTANCE])
PIXEL = DISTANCE / FOCAL  # metres at the origin
LEFT = np.tile(np.arange(WIDTH) < WIDTH // 2, (HEIGHT, 1))  # the half where x < 0


def across(x, depth=0.0):
    """Return strands that go from x = -2 cm to these, `depth` behind the origin."""
    x = np.asarray(x, float)
    line = -0.02 + np.linspace(0.0, 1.0, 50) * (x[:, None] + 0.02)
    rest = np.zeros_like(line)
    return np.stack([line, rest, rest - depth], axis=-1)


def test_how_far_strands_come_out_of_the_mask():
    sight = Sight(view_of(CAMERA, LEFT), None)
    found = comes_out(across([-0.01, 0.009, 0.04]), sight).anywhere.max(axis=1)
    assert found[0] == 0.0
    free = FREE * PIXEL
    assert found[1:] == pytest.approx([0.009 - free, 0.04 - free], abs=PIXEL)
    # Twice as far from the camera a pixel is twice as wide.
    away, in_air = comes_out(across([0.04], depth=DISTANCE), sight)
    assert away.max() == pytest.approx(0.04 - 2 * free, abs=2 * PIXEL)
    assert (away == in_air).all()


def test_what_the_head_hides_or_the_picture_leaves_out_says_nothing():
    strands = across([0.04])
    before, after = (np.full(LEFT.shape, DISTANCE + step) for step in (-0.01, 0.01))
    view = view_of(CAMERA, LEFT)

    def out(points, behind=None):
        return comes_out(points, Sight(view, behind)).anywhere

    assert (out(strands, before) == 0.0).all()
    found = out(strands, after)
    assert found.shape == strands.shape[:2] and found.max() > 0.03
    assert (found[strands[..., 0] < 0.0] == 0.0).all()
    assert (out(strands + [1.0, 0.0, 0.0]) == 0.0).all()
    assert out(strands - [0.0, 0.0, 1.0]).any()
    assert (out(strands + [0.0, 0.0, 1.0]) == 0.0).all()


def test_what_comes_out_before_the_head_and_in_the_air():
    strands = across([0.04])
    head = np.where(np.arange(WIDTH) < WIDTH // 2 + 6, DISTANCE + 0.01, np.inf)
    behind = np.tile(head, (HEIGHT, 1))
    found = comes_out(strands, Sight(view_of(CAMERA, LEFT), behind))
    beyond = strands[..., 0] > 6 * PIXEL
    assert (found.in_air[~beyond] == 0.0).all() and found.anywhere[~beyond].any()
    assert (found.in_air[beyond] == found.anywhere[beyond]).all() and beyond.any()


def test_a_mask_without_hair_says_nothing():
    view = view_of(CAMERA, np.zeros_like(LEFT))
    assert not np.any(comes_out(across([0.04]), Sight(view, None)))


@pytest.mark.parametrize("radius", [0.0, 0.004])
def test_roots_are_as_dense_as_strands_stay_in(radius):
    finer = 32  # nine pixels a millimetre, so that the mask ends where it is said to
    fine = camera_at([0.0, 0.0, DISTANCE], finer=finer)
    hair = np.tile(np.arange(fine.width) < fine.width // 2, (fine.height, 1))
    free = FREE * PIXEL / finer + TURN * radius
    # The same strand, in the hair, half lost at its tip, lost there, and all the more.
    points = 50
    strand = np.tile([-0.01, 0.0, 0.0], (4, points, 1))
    lost = round(0.5 * MOST_LOST * points)
    strand[0, -lost:, 0] = free
    strand[1, -lost:, 0] = free + 0.5 * LOST
    strand[2, -lost:, 0] = free + 2.0 * LOST
    strand[3, -3 * lost :, 0] = free + 2.0 * LOST
    uv = jnp.asarray([[0.2, 0.2], [0.2, 0.8], [0.8, 0.2], [0.8, 0.8]])
    strands = Hair(jnp.asarray(strand), uv, jnp.zeros(4, int), jnp.zeros(4))
    sights = [Sight(view_of(fine, hair), None)]
    maps = without_strays(EVEN, strands, sights, radius)
    found = texels_at(maps.density, uv)
    share = lost / points / MOST_LOST
    expected = [1.0, 1.0 - 0.5 * share, 1.0 - share, SPARSEST]
    assert found == pytest.approx(expected, abs=0.05)
    assert found[3] == pytest.approx(SPARSEST)
    # Nothing is known where no root is.
    assert maps.density[80, 80] == 1.0
    half = eqx.tree_at(lambda m: m.density, EVEN, 0.5 * EVEN.density)
    again = without_strays(half, strands, sights, radius)
    assert np.allclose(again.density, 0.5 * maps.density)


def test_texels_between_sparse_roots_follow_the_strands_around():
    strands = across([-0.01, -0.01, 0.04, 0.04])
    step = 3.0 / (TEXELS - 1)  # so that roots lie two texels and more apart
    row = [0.2, 0.2 + step, 0.8, 0.8 + step]
    uv = jnp.asarray([[0.5, one] for one in row])
    hair = Hair(jnp.asarray(strands), uv, jnp.zeros(4, int), jnp.zeros(4))
    maps = without_strays(EVEN, hair, [Sight(view_of(CAMERA, LEFT), None)], 0.0)
    middle = jnp.asarray([[0.5, 0.2 + 0.5 * step], [0.5, 0.8 + 0.5 * step]])
    found = texels_at(maps.density, jnp.concatenate([uv, middle]))
    assert found == pytest.approx([1.0, 1.0, SPARSEST, SPARSEST, 1.0, SPARSEST])


def lanes():
    """Return strands in 12 lanes of the left half, some tips out of it, and the mask.

    All lanes but the last hold 40 strands; of these and of the one strand in the last
    two come out by 1 mm each, two by more than `SEEN_OUT`, for longer than any may.
    """
    height = 0.001 * np.arange(12)
    line = np.linspace(-0.012, 0.0, 50)
    strand = np.stack(np.broadcast_arrays(line, height[:, None], 0.0), axis=-1)
    lane = np.concatenate([np.repeat(np.arange(11), 40), [11, 11]])
    points = strand[lane]
    tips = 2 * round(MOST_LOST * 50)
    for row, out in ((0, 0.001), (1, SEEN_OUT), (-2, 0.001), (-1, SEEN_OUT)):
        points[row, -tips:, 0] = out + 1.5 * FREE * PIXEL / 32
    camera = camera_at([0.0, 0.0, DISTANCE], finer=32)
    y, x = np.mgrid[: camera.height, : camera.width]
    metres = DISTANCE / camera.focal
    up, right = (camera.height / 2 - y) * metres, (x - camera.width / 2) * metres
    mask = (np.abs(up - 0.0055) < 0.006) & (right < 0.0) & (right > -0.012)
    return points, Sight(view_of(camera, mask), None)


def test_strands_stay_that_come_out_in_the_air_and_hide_what_nothing_else_hides():
    points, sight = lanes()
    asked = np.array([0, 1, len(points) - 2, len(points) - 1])
    stays = np.ones(len(points))
    stays[asked] = 0.0
    found = hides_bare(points, asked, stays, [sight])
    inside = (points[asked, :, 0] < 0.0).mean(axis=1)
    assert found[:2] == pytest.approx(0.0)
    assert found[2:] == pytest.approx(inside[2:], abs=0.1)
    # With another strand there they hide what is hidden anyway.
    stays[asked[2]] = 40.0
    assert hides_bare(points, asked, stays, [sight])[3] == pytest.approx(0.0)
    uv = (
        jnp.asarray(np.full((len(points), 2), 0.9))
        .at[asked]
        .set([[0.2, 0.2], [0.2, 0.8], [0.8, 0.2], [0.8, 0.8]])
    )
    count = jnp.zeros(len(points), int)
    hair = Hair(jnp.asarray(points), uv, count, count.astype(float))
    skin = np.full(sight.view.hair.shape, 2.0 * DISTANCE)
    for behind, stays in ((None, 1.0), (skin, SPARSEST)):
        maps = without_strays(EVEN, hair, [Sight(sight.view, behind)], 0.0)
        found = texels_at(maps.density, uv[asked])
        wanted = [SPARSEST, SPARSEST, stays, SPARSEST]
        assert found == pytest.approx(wanted, abs=0.02)


def test_strands_that_arch_out_go_and_their_neighbours_stay():
    roots, uv = every_root(4000, np.random.default_rng(0))
    wild = np.random.default_rng(1).random(4000) < 0.05
    strands = comb(roots)
    arched = comb(roots, height=0.03)
    hair = hair_of(roots, uv)._replace(
        strands=jnp.asarray(np.where(wild[:, None, None], arched, strands))
    )
    sights = [Sight(v, None) for v in photograph(strands, ring(8), None).views]
    maps = without_strays(EVEN, hair, sights, 0.0)
    density = texels_at(maps.density, uv)
    far = np.max([comes_out(arched, sight).anywhere for sight in sights], axis=0)
    out = (far > LOST).mean(axis=1) > MOST_LOST
    assert out[wild].mean() > 0.5
    assert density[wild & out].mean() < 0.5
    assert density[~wild].mean() > 0.85
    assert (maps.length == EVEN.length).all() and (maps.curl == EVEN.curl).all()


def test_no_strands_leave_the_maps_as_they_are():
    sight = Sight(view_of(CAMERA, LEFT), None)
    assert eqx.tree_equal(without_strays(EVEN, no_hair(), [sight], 0.0), EVEN)


def rings(radii, length, points=200):
    """Return strands of a length that run round circles of these radii."""
    angle = np.linspace(0.0, length, points) / np.asarray(radii)[:, None]
    turn = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    return turn * np.asarray(radii)[:, None, None]


def test_how_far_strands_come_forward():
    radii = np.array([LOOP / (2.0 * np.pi), 0.005, 0.02, 1e3])
    found = comes_forward(rings(radii, 3.0 * LOOP))
    half = 0.5 * LOOP / radii
    # A chord of a circle is twice the radius times the sine of half the angle.
    assert found == pytest.approx(np.abs(np.sin(half)) / half, abs=0.02)
    # The same where one stretch alone loops, and with points far apart.
    one = np.concatenate([across([0.04])[0], [0.04, 0.0, 0.0] + rings(radii, LOOP)[0]])
    assert comes_forward(one[None])[0] < FORWARD
    coarse = comes_forward(rings([0.005], 3.0 * LOOP, points=13))
    assert coarse == pytest.approx(found[1:2], abs=0.1)
    assert (comes_forward(rings(radii, 0.9 * LOOP)) == 1.0).all()


@pytest.mark.parametrize(("radius", "stays"), [(0.0, SPARSEST), (0.006, 1.0)])
def test_strands_in_loops_go_unless_hair_curls(radius, stays):
    straight = across([0.06])
    strands = np.concatenate([straight, rings([0.004], 0.08, points=50)])
    assert (comes_forward(strands) < FORWARD).tolist() == [False, True]
    uv = jnp.asarray([[0.2, 0.2], [0.8, 0.8]])
    hair = Hair(jnp.asarray(strands), uv, jnp.zeros(2, int), jnp.zeros(2))
    sights = [Sight(view_of(CAMERA, np.ones_like(LEFT)), None)]
    maps = without_strays(EVEN, hair, sights, radius)
    found = texels_at(maps.density, uv)
    assert found == pytest.approx([1.0, stays], abs=1e-6)
