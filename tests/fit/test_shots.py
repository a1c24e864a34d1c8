import dataclasses

import jax
import numpy as np
import pytest
from ball_hair import RADIUS, ball, camera_at, comb, hull_where, photograph, ring
from scipy.ndimage import uniform_filter1d

from hairfit.capture import View
from hairfit.capture.orientation import estimate_orientation
from hairfit.fit.checkpoint import Checkpoint
from hairfit.fit.hull import pixel_sizes
from hairfit.fit.residuals import seen_segments
from hairfit.fit.shots import (
    PIXEL,
    Shots,
    coarser_sights,
    look_at,
    resampled,
    wrapped_scalp,
)
from hairfit.fit.trust import Trusted
from hairfit.model.scalp import points_on, sample_roots
from hairfit.render.raster import project_points

HULL = hull_where(lambda p: np.abs(p[:, 2]) < 0.01, [-0.06] * 3, [0.06] * 3, 0.01)


def curtain(z, x):
    """Return straight hairs that hang side by side."""
    y = np.linspace(0.05, -0.05, 12)
    hairs = np.broadcast_arrays(x[:, None], y[None], z)
    return np.stack(hairs, axis=-1).astype(float)


def layers():
    """Return hairs 2 mm apart, and as many behind the gaps between them."""
    x = np.arange(-0.04, 0.04, 0.002)
    return curtain(0.01, x), curtain(-0.01, x + 0.001)


def shots_of(strands, finer):
    camera = camera_at([0.0, 0.0, 0.2], finer=finer)
    found = photograph(strands, [camera], None, radius_px=0.5 * finer)
    trusted = Trusted(tuple(found.views), found.depths, [True])
    return Shots(found.views, found.depths, [0], trusted, ()), found.maps


def behind_seen(sights):
    front, back = layers()
    views, depths = zip(*sights, strict=True)
    seen = seen_segments(np.concatenate([front, back]), views, depths)[0]
    return seen[len(front) :].mean()


def test_few_strands_hide_as_much_in_photographs_with_finer_pixels():
    front, back = layers()
    strands = np.concatenate([front, back])
    coarse, _ = shots_of(strands, 2)
    fine, _ = shots_of(strands, 8)
    assert behind_seen(zip(coarse.views, coarse.depths, strict=True)) < 0.1
    assert behind_seen(zip(fine.views, fine.depths, strict=True)) > 0.4
    assert behind_seen(coarser_sights(fine, HULL)) < 0.1


def test_a_reduced_photograph_shows_hair_where_it_did():
    strands = curtain(0.0, np.linspace(-0.02, 0.02, 30))
    shots, maps = shots_of(strands, 8)
    (sight,) = coarser_sights(shots, HULL)
    view = sight.view
    assert pixel_sizes(HULL, [view]) == [pytest.approx(PIXEL, rel=0.01)]
    assert sight.behind is not None and np.isinf(sight.behind).all()
    pixel = project_points(strands.reshape(-1, 3), view.camera).pixel
    x, y = pixel.astype(int).T
    assert view.hair[y, x].mean() > 0.95
    assert view.hair.mean() == pytest.approx(shots.views[0].hair.mean(), rel=0.05)
    (found,) = resampled(maps, [sight])
    assert found.angle.shape == view.hair.shape
    upright = np.abs(np.sin(found.angle - 0.5 * np.pi))[view.hair]
    assert np.percentile(upright, 90) < np.sin(np.radians(1.0))
    assert (found.confidence > 0.0)[view.hair].mean() > 0.9
    assert not found.confidence[:, :5].any()


def test_photographs_with_coarse_pixels_stay_as_they_are():
    shots, maps = shots_of(curtain(0.0, np.linspace(-0.02, 0.02, 5)), 2)
    (sight,) = coarser_sights(shots, HULL)
    assert sight.view is shots.views[0] and sight.behind is shots.depths[0]
    assert resampled(maps, [sight]) == maps


def hanging(shaken):
    """Return photographs of hair that hangs, smeared along so many pixels."""
    rng = np.random.default_rng(0)
    x = np.mgrid[:360, :360][1]
    grain = 0.2 * rng.normal(size=360)[x] + 0.3 * rng.normal(size=x.shape)
    grain += 0.6 * np.sin(x / 3.0)
    sharp = np.repeat(0.05 * np.exp(grain)[..., None], 3, axis=2).astype(np.float32)
    hair, camera = np.ones(x.shape, bool), camera_at([0.0, 0.0, 0.2])
    images = [uniform_filter1d(sharp, size, axis=1) for size in shaken]
    names = "abcdefgh"[: len(images)]
    views = tuple(View(n, camera, i, hair) for n, i in zip(names, images, strict=True))
    depths = [np.full(x.shape, np.inf)] * len(views)
    every = list(range(len(views)))
    return Shots(
        [*views], depths, every, Trusted(views, depths, [True] * len(every)), ()
    )


def test_a_shaken_photograph_is_named_and_kept_with_its_map(tmp_path):
    shots, done = hanging([1, 7]), []
    seen, maps = look_at(shots, Checkpoint(tmp_path), done.append)
    assert done == [0.5, 1.0]
    (doubt,) = seen.doubts
    assert (doubt.view, doubt.kind, doubt.remedy) == ("b", "shaken", "look smaller")
    assert doubt.strength > 0.3 and "'b' is shaken" in doubt.sentence
    for found in maps:
        assert np.median(np.abs(found.angle - 0.5 * np.pi)) < np.radians(3.0)
    again, kept = look_at(shots, Checkpoint(tmp_path), done.append)
    assert again.doubts == seen.doubts
    for one, other in zip(maps, kept, strict=True):
        np.testing.assert_array_equal(one.angle, other.angle)
        np.testing.assert_array_equal(one.confidence, other.confidence)


@pytest.mark.parametrize(("shaken", "all_small"), [([1, 7, 9], True), ([1, 7], False)])
def test_where_several_are_shaken_all_are_looked_at_in_smaller_pictures(
    shaken, all_small
):
    shots = hanging(shaken)
    sharp = shots.views[0]
    seen, maps = look_at(shots, Checkpoint(None), lambda share: None)
    assert [doubt.view for doubt in seen.doubts] == ["b", "c"][: len(shaken) - 1]
    plain = estimate_orientation(sharp.image, sharp.hair)
    assert np.array_equal(maps[0].angle, plain.angle) == (not all_small)
    assert np.median(np.abs(maps[0].angle - 0.5 * np.pi)) < np.radians(3.0)


def test_shorn_hair_grows_though_skin_shows_between():
    rng = np.random.default_rng(0)
    head = ball()
    hairs = comb(RADIUS * np.array([[0.0, 1.0, 0.0]]))
    found = photograph(hairs, ring(6, finer=6), head)
    lowest = []
    for share in (1.0, 0.35):
        views = []
        for view, depth in zip(found.views, found.depths, strict=True):
            below = np.arange(view.camera.height)[:, None] > 0.55 * view.camera.height
            skin = np.isfinite(depth) & ~below
            hair = skin & (rng.random(skin.shape) < share)
            views.append(dataclasses.replace(view, hair=hair))
        trusted = Trusted(tuple(views), found.depths, [True] * len(views))
        every = list(range(len(views)))
        shots = Shots(views, found.depths, every, trusted, ())
        scalp = wrapped_scalp(shots, head)
        uv = sample_roots(scalp, 2000, jax.random.key(0))
        lowest.append(np.quantile(np.asarray(points_on(scalp, uv))[:, 1], 0.02))
    assert abs(lowest[0] - lowest[1]) < 0.003
    assert lowest[0] < 0.3 * RADIUS
