import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import (
    RADIUS,
    ball,
    camera_at,
    photograph,
    sphere_depth,
    view_of,
)
from jax.test_util import check_grads

from hairfit.capture.orientation import OrientationMap
from hairfit.fit import residuals
from hairfit.fit.residuals import (
    BARE,
    FARTHEST,
    SEEN_DEPTH,
    SIGMA_ANGLE,
    SIGMA_BARE,
    SIGMA_OUTSIDE,
    Pulls,
    bare_loss,
    find_pulls,
    image_loss,
    photo_maps,
    seen_segments,
)
from hairfit.render import Camera

CAMERA = camera_at([0.0, 0.0, 0.6])
PIXEL = 0.6 / 160.0  # metres at the origin


def exact(module):
    """Return maps or fields in float64, for gradients."""
    return jax.tree.map(
        lambda x: x.astype(float) if jnp.issubdtype(x.dtype, jnp.floating) else x,
        module,
    )


def curtain(angle=0.0, count=30, knots=8, length=0.08):
    """Return parallel strands in the plane z = 0, `angle` away from straight down."""
    x = np.linspace(-0.05, 0.05, count)
    along = np.array([np.sin(angle), -np.cos(angle), 0.0])
    root = np.stack([x, np.full(count, 0.04), np.zeros(count)], axis=1)
    t = np.linspace(0.0, length, knots)
    return root[:, None] + t[None, :, None] * along


def maps_of(hair, angle, confidence=1.0):
    """Return the maps of one view that has one angle everywhere."""
    shape = hair.shape
    sure = np.full(shape, float(confidence))
    found = OrientationMap(np.full(shape, float(angle)), sure, 0.07 * sure)
    return exact(photo_maps([view_of(CAMERA, hair)], [found], [np.full(shape, np.inf)]))


def everywhere():
    return np.ones((CAMERA.height, CAMERA.width), bool)


def all_seen(strands):
    return jnp.ones((1, strands.shape[0], strands.shape[1] - 1), bool)


def test_strands_that_made_the_maps_agree_with_them():
    strands = curtain()
    taken = photograph(strands, [CAMERA], None)
    maps = exact(photo_maps(taken.views, taken.maps, taken.depths))
    seen = jnp.asarray(seen_segments(strands, taken.views, taken.depths))
    assert seen.mean() > 0.9
    assert image_loss(jnp.asarray(strands), seen, maps) < 0.01
    turned = jnp.asarray(curtain(0.3))
    assert image_loss(turned, seen, maps) > 1.0


@pytest.mark.parametrize("off", [0.1, 0.4, 1.2, np.pi / 2])
def test_the_angles_loss_is_the_sine_of_the_angle_between(off):
    strands = jnp.asarray(curtain())
    maps = maps_of(everywhere(), (np.pi / 2 + off) % np.pi)
    found = image_loss(strands, all_seen(strands), maps)
    assert np.isclose(found, np.sin(off) / SIGMA_ANGLE, rtol=2e-3, atol=8e-3)


def test_confidence_weighs_pixels_against_each_other_and_none_counts_nothing():
    strands = jnp.asarray(curtain())
    seen = all_seen(strands)
    nothing = image_loss(strands, seen, maps_of(everywhere(), 0.3, confidence=0.0))
    assert np.isclose(nothing, 0.0, atol=1e-9)
    half = maps_of(everywhere(), np.pi / 2)
    sure = np.where(np.arange(64) < 32, 1.0, 0.25)[None, None, :, None]
    doubled = np.where(np.arange(64) < 32, -1.0, 1.0)[None, None, :, None] * sure
    doubled = doubled * np.array([1.0, 0.0])  # left half agrees, right half is level
    half = eqx.tree_at(
        lambda m: m.doubled, half, jnp.broadcast_to(doubled, half.doubled.shape)
    )
    # Half of the strands at weight 1 agree; the others at weight 1/4 are off by 90.
    expected = 0.25 / 1.25 / SIGMA_ANGLE
    assert np.isclose(image_loss(strands, seen, half), expected, rtol=0.02)


def test_segments_that_no_view_sees_have_no_angle():
    strands = jnp.asarray(curtain())
    maps = maps_of(everywhere(), 0.0)
    assert image_loss(strands, jnp.zeros((1, 30, 7), bool), maps) < 1e-6


def test_outside_the_mask_the_loss_is_the_distance():
    hair = everywhere()
    hair[:, 64:] = False
    maps = maps_of(hair, 0.0, confidence=0.0)
    for shift in (0.02, 0.03, 0.2):
        strands = np.repeat(curtain(count=1), 40, axis=0)
        strands[..., 0] = shift
        strands = jnp.asarray(strands)
        away = min(shift, FARTHEST)
        expected = (away - 0.001) / SIGMA_OUTSIDE
        found = image_loss(strands, all_seen(strands), maps)
        if shift > 0.15:
            assert expected == (FARTHEST - 0.001) / SIGMA_OUTSIDE
        assert np.isclose(found, expected, atol=PIXEL / SIGMA_OUTSIDE)
    inside = jnp.asarray(curtain() - [0.1, 0.0, 0.0])
    assert image_loss(inside, all_seen(inside), maps) < 1e-6


def test_what_the_head_hides_is_not_outside_the_mask():
    hair = np.zeros_like(everywhere())
    hair[:2, :2] = True
    maps = maps_of(hair, 0.0, confidence=0.0)
    maps = eqx.tree_at(lambda m: m.head, maps, jnp.full_like(maps.head, 0.5))
    strands = jnp.asarray(curtain())
    assert image_loss(strands, all_seen(strands), maps) < 1e-6


def test_smaller_pictures_are_padded_and_say_nothing_there():
    large, small = everywhere(), everywhere()[:64, :64]
    tiny = Camera(CAMERA.K, CAMERA.cam_from_world, 64, 64)
    found = [
        OrientationMap(np.zeros(h.shape), np.ones(h.shape), np.ones(h.shape))
        for h in (large, small)
    ]
    views = [view_of(CAMERA, large), view_of(tiny, small)]
    maps = photo_maps(views, found, [np.full(h.shape, np.inf) for h in (large, small)])
    assert maps.doubled.shape == (2, 64, 64, 2)
    assert (maps.doubled[1, 32:] == 0).all() and (maps.doubled[1, :, 32:] == 0).all()
    assert (maps.doubled[1, :32, :32, 0] == 1).all()


def test_the_image_losss_gradient_is_right():
    hair = everywhere()
    hair[:, 70:] = False
    maps = maps_of(hair, 1.2, confidence=0.6)
    rng = np.random.default_rng(0)
    strands = jnp.asarray(curtain(0.1, count=4) + 1e-3 * rng.normal(size=(4, 8, 3)))
    loss = jax.jit(lambda s: image_loss(s, all_seen(s), maps))
    check_grads(loss, (strands,), order=1, modes=["rev"], eps=1e-7, rtol=2e-3)


def test_a_strand_that_points_at_the_camera_has_a_finite_gradient():
    eye = np.asarray(CAMERA.centre)
    strand = jnp.asarray(eye * np.linspace(0.0, 0.1, 6)[:, None])[None]
    maps = maps_of(everywhere(), 0.5)
    loss, gradient = jax.value_and_grad(image_loss)(strand, all_seen(strand), maps)
    assert np.isfinite(loss) and np.isfinite(np.asarray(gradient)).all()


def test_photographs_see_what_is_neither_behind_the_head_nor_deep_in_hair():
    front = curtain(count=60) + [0.0, 0.0, 0.1]
    deep = curtain(count=60) + [0.0, 0.0, 0.1 - 4 * SEEN_DEPTH]
    behind = curtain(count=60) - [0.0, 0.0, 0.1]
    strands = np.concatenate([front, deep, behind])
    view = view_of(CAMERA, everywhere())
    depth = sphere_depth(CAMERA, RADIUS)
    seen = seen_segments(strands, [view], [depth])[0]
    assert seen[:60].all()
    assert not seen[70:110].any()  # but for the outermost, at the curtain's sides
    assert not seen[120:].any()
    alone = seen_segments(behind, [view], [np.full(depth.shape, np.inf)])[0]
    assert alone.all()


def patch():
    """Return a view whose hair is a patch of pixels right of all strands."""
    hair = np.zeros_like(everywhere())
    hair[60:66, 84:90] = True
    return view_of(CAMERA, hair), [np.full(hair.shape, np.inf)]


def test_bare_pixels_pull_the_nearest_strand():
    view, free = patch()
    strands = curtain()
    pulls = find_pulls(strands, [view], free, 0)
    weight = np.asarray(pulls.share[0])
    assert np.isclose(weight.sum(), 1.0)  # all of the patch is bare
    used = weight > 0
    assert used.sum() == view.hair.sum()
    assert (np.asarray(pulls.strand[0])[used] == 29).all()
    assert (np.asarray(pulls.point[0])[used] > 0).all()
    asked = np.floor(2 * np.asarray(pulls.pixel[0])[used]).astype(int)
    assert view.hair[asked[:, 1], asked[:, 0]].all()


def test_covered_pixels_and_far_ones_pull_nothing():
    strands = curtain(count=200, knots=80)
    taken = photograph(strands[:, 2:-2], [CAMERA], None, radius_px=0.0)
    assert BARE < PIXEL  # a covered pixel may be a pixel away
    pulls = find_pulls(strands, taken.views, taken.depths, 0)
    assert float(pulls.share.sum()) < 0.25
    corner = np.zeros_like(everywhere())
    corner[:3, :3] = True
    far = find_pulls(strands, [view_of(CAMERA, corner)], taken.depths, 0)
    assert float(far.share.sum()) == 0.0


def test_the_bare_loss_is_the_distance_and_falls_on_the_way_to_the_patch():
    view, free = patch()
    strands = curtain()
    maps = exact(photo_maps([view], [uncertain(view)], free))
    pulls = find_pulls(strands, [view], free, 0)
    losses = []
    for step in np.linspace(0.0, 0.03, 7):
        closer = strands.copy()
        closer[29, :, 0] += step
        losses.append(float(bare_loss(jnp.asarray(closer), exact(pulls), maps)))
    assert (np.diff(losses) < 0).all()
    used = np.asarray(pulls.share[0]) > 0
    point = strands[29, np.asarray(pulls.point[0])[used]]
    target = (2 * np.asarray(pulls.pixel[0])[used] - 64.0) * PIXEL * [1.0, -1.0]
    away = np.linalg.norm(point[:, :2] - target, axis=1)
    assert np.isclose(losses[0], away.mean() / SIGMA_BARE, rtol=1e-3)


def uncertain(view):
    nothing = np.zeros(view.hair.shape)
    return OrientationMap(nothing, nothing, np.ones(view.hair.shape))


def test_the_bare_losss_gradient_is_right():
    view, free = patch()
    maps = exact(photo_maps([view], [uncertain(view)], free))
    one = Pulls(
        jnp.array([[0, 0, 1]]),
        jnp.array([[1, 1, 2]]),
        jnp.array([[[40.0, 30.0], [41.0, 31.0], [36.0, 30.0]]]),
        jnp.array([[0.5, 0.3, 0.0]]),
    )
    strands = jnp.asarray(curtain(count=2))
    loss = jax.jit(lambda s: bare_loss(s, one, maps))
    check_grads(loss, (strands,), order=1, modes=["rev"], eps=1e-7, rtol=1e-3)
    gradient = np.asarray(jax.grad(loss)(strands))
    assert (gradient[1] == 0).all()  # its pull has no share


def test_no_strand_in_sight_and_no_hair_is_no_error():
    view, free = patch()
    behind = [np.zeros_like(depth) for depth in free]
    assert float(find_pulls(curtain(), [view], behind, 0).share.sum()) == 0.0


def test_maps_of_a_ball_have_its_depth():
    camera = CAMERA
    taken = photograph(curtain(), [camera], ball())
    maps = photo_maps(taken.views, taken.maps, taken.depths)
    expected = sphere_depth(camera, RADIUS)[::2, ::2]
    found = np.asarray(maps.head[0])
    both = np.isfinite(expected) & np.isfinite(found)
    assert both.sum() > 300
    assert np.abs(found[both] - expected[both]).max() < 0.004
    assert np.isclose(maps.focal[0], 160.0) and np.isclose(maps.K[0, 0, 0], 80.0)


def test_how_many_photographs_are_compared_together_changes_nothing(monkeypatch):
    rng = np.random.default_rng(4)
    shape = (CAMERA.height, CAMERA.width)
    hair = [rng.random(shape) < 0.5 for _ in range(5)]
    ones = np.ones(shape)
    found = [
        OrientationMap(angle * ones, ones, ones) for angle in rng.uniform(0, np.pi, 5)
    ]
    views = [view_of(CAMERA, mask) for mask in hair]
    maps = exact(photo_maps(views, found, [np.full(shape, np.inf)] * 5))
    strands = jnp.asarray(curtain(0.4))
    seen = jnp.asarray(rng.random((5, *strands[:, 1:, 0].shape)) < 0.5)
    losses = []
    for at_once in (1, 2, 5, 8):
        monkeypatch.setattr(residuals, "AT_ONCE", at_once)
        losses.append(float(image_loss(strands, seen, maps)))
    assert losses[0] > 1.0
    assert np.allclose(losses, losses[0], rtol=1e-12)
