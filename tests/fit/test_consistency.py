import dataclasses

import numpy as np
import pytest
from ball_hair import all_centres, camera_at, hull_where, view_of

from hairfit.capture.orientation import SIGMA_SURE, OrientationMap
from hairfit.fit.consistency import (
    BESIDE,
    Contradictions,
    carve_by_consistency,
    carve_layers,
    contradictions,
    directions_agree,
    ratio_around,
    unsure_of_place,
    usual_shade,
)
from hairfit.fit.hull import hull_of
from hairfit.fit.shades import Shade
from hairfit.render.raster import project_points

TRUE, WIDE = 0.058, 0.068
NOISE = 1.5 * SIGMA_SURE
TURNS = 90.0  # radians that the direction turns in a metre
SPOTS = 150.0  # likewise, of dark and bright


@pytest.fixture(scope="module")
def hull():
    return hull_where(
        lambda p: np.linalg.norm(p, axis=1) < WIDE, [-0.08] * 3, [0.08] * 3, 0.004
    )


def upright(p):
    """Hair that hangs down everywhere."""
    return np.tile([0.0, 1.0, 0.0], (len(p), 1))


def waved(p):
    """Hair on the ball that lies in its surface and turns from place to place."""
    out = p / np.linalg.norm(p, axis=1, keepdims=True)
    side = np.cross([0.0, 1.0, 0.0], out)
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    angle = 0.8 * np.sin(TURNS * p[:, 1:2]) + 0.8 * np.sin(TURNS * p[:, :1])
    return np.cos(angle) * np.cross(out, side) + np.sin(angle) * side


def spotted(p):
    """How bright hair on the ball is: dark between locks, a lock for each of many."""
    return np.exp(0.7 * np.sin(SPOTS * p).sum(axis=1)) / 20.0


def plain(p):
    return np.full(len(p), 0.05)


def photograph(eye, direction, rng, brightness=plain):
    """Return a view of the ball and the angles of the hair on it, with their noise."""
    camera = camera_at(eye, finer=3)
    y, x = np.mgrid[: camera.height, : camera.width]
    pixel = np.stack([x + 0.5, y + 0.5, np.ones(x.shape)], axis=-1).reshape(-1, 3)
    cam = np.asarray(camera.cam_from_world, np.float64)
    ray = np.linalg.solve(np.asarray(camera.K, np.float64), pixel.T).T @ cam[:3, :3]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    along = -(ray @ eye)
    root = along**2 - (eye @ eye - TRUE**2)
    struck = root > 0
    hit = eye + ray * (along - np.sqrt(np.maximum(root, 0.0)))[:, None]
    ahead = project_points(hit + 1e-4 * direction(hit), camera).pixel
    step = ahead - project_points(hit, camera).pixel
    angle = np.arctan2(step[:, 1], step[:, 0]) + rng.normal(0, NOISE, len(step))
    shape = x.shape
    sure = (SIGMA_SURE / NOISE) ** 2 * struck.reshape(shape)
    sigma = np.full(shape, NOISE)
    found = OrientationMap((angle % np.pi).reshape(shape), sure, sigma)
    # The mask is too wide: it is the hull's, not the hair's.
    hair = np.linalg.norm(hit, axis=1) < WIDE + 0.008
    view = view_of(camera, hair.reshape(shape))
    grey = brightness(hit).reshape(*shape, 1)
    image = np.broadcast_to(grey, (*shape, 3)).astype(np.float32)
    return dataclasses.replace(view, image=image), found


def ring(direction, count=8, brightness=plain):
    rng = np.random.default_rng(0)
    turn = 2 * np.pi * np.arange(count) / 8
    eyes = 0.6 * np.stack([np.sin(turn), 0.1 + 0 * turn, np.cos(turn)], axis=1)
    photographs = (photograph(eye, direction, rng, brightness) for eye in eyes)
    views, maps = zip(*photographs, strict=True)
    return views, maps, [np.full(view.hair.shape, np.inf) for view in views]


def disagreement(hull, views, maps, depths):
    flat = [Shade(0.0 * found.sigma, 1.0 + 0.0 * found.sigma) for found in maps]
    flat = [Shade(*(one.astype(np.float32) for one in shade)) for shade in flat]
    return contradictions(hull, views, maps, depths, flat).turned


def test_hair_that_turns_tells_where_its_surface_is(hull):
    carved = carve_by_consistency(hull, *ring(waved))
    radius = np.linalg.norm(hull.grid.centres(hull.hair), axis=1)
    height = np.abs(hull.grid.centres(hull.hair)[:, 1])
    left = carved.hair[hull.hair]
    outer = (radius > TRUE + 0.004) & (height < 0.5 * TRUE)
    assert left[outer].mean() < 0.6
    assert left[radius < TRUE - 0.003].mean() > 0.99
    assert (carved.distance[carved.hair] < 0).all()


def test_hair_that_runs_one_way_tells_nothing(hull):
    carved = carve_by_consistency(hull, *ring(upright))
    assert (carved.hair & hull.hair).sum() > 0.98 * hull.hair.sum()


def test_hair_that_nothing_else_explains_stays(hull, monkeypatch):
    def without_a_band(whole, ask):
        band = np.abs(all_centres(whole)[..., 1]) < 0.02
        return hull_of(whole.grid, whole.hair & ~band, whole.head)

    monkeypatch.setattr("hairfit.fit.consistency.carve_layers", without_a_band)
    carved = carve_by_consistency(hull, *ring(waved))
    # Above and below it voxels beside the band explain the next.
    band = hull.hair & (np.abs(all_centres(hull)[..., 1]) < 0.008)
    assert carved.hair[band].mean() > 0.9
    assert (carved.distance[carved.hair] < 0).all()


@pytest.fixture(scope="module")
def bulging():
    """A hull that is as large as the ball, but for a bulge that masks allow."""

    def inside(p):
        radius = np.linalg.norm(p, axis=1)
        return (radius < TRUE) | ((radius < WIDE + 0.004) & (p[:, 2] > 0.6 * radius))

    return hull_where(inside, [-0.08] * 3, [0.08] * 3, 0.004)


def shares_left(hull, carved):
    """What is left of a bulge, and of the ball."""
    points = hull.grid.centres(hull.hair)
    radius, left = np.linalg.norm(points, axis=1), carved.hair[hull.hair]
    return left[radius > TRUE + 0.004].mean(), left[radius < TRUE].mean()


def test_shadows_tell_of_a_bulge_in_hair_that_runs_one_way(bulging):
    carved = carve_by_consistency(bulging, *ring(upright, brightness=spotted))
    bulge, ball = shares_left(bulging, carved)
    assert bulge < 0.5
    assert ball > 0.97
    plain_hair = carve_by_consistency(bulging, *ring(upright))
    assert shares_left(bulging, plain_hair)[0] > 0.95


def test_shadows_are_not_asked_where_skin_shows_between_hairs(bulging):
    near_skin = dataclasses.replace(bulging, head=np.full(bulging.hair.shape, 0.004))
    carved = carve_by_consistency(near_skin, *ring(upright, brightness=spotted))
    assert shares_left(near_skin, carved)[0] > 0.95


def test_shadows_of_photographs_that_are_exposed_otherwise_tell_the_same(bulging):
    views, maps, depths = ring(upright, brightness=spotted)
    gain = np.array([1.0, 1.5, 0.7, 1.0, 1.3, 0.6, 1.2, 0.9], np.float32)
    views = [
        dataclasses.replace(view, image=one * view.image)
        for view, one in zip(views, gain, strict=True)
    ]
    bulge, ball = shares_left(
        bulging, carve_by_consistency(bulging, views, maps, depths)
    )
    assert bulge < 0.5
    assert ball > 0.97


def test_two_views_never_disagree(hull):
    views, maps, depths = ring(waved, count=2)
    assert carve_by_consistency(hull, views, maps, depths) is hull
    assert disagreement(hull, views, maps, depths).max() == 0.0


def test_disagreement_is_one_on_the_surface(hull):
    narrow = hull_where(
        lambda p: np.linalg.norm(p, axis=1) < TRUE, [-0.08] * 3, [0.08] * 3, 0.004
    )
    found = disagreement(narrow, *ring(waved))
    asked = found[narrow.hair & (found > 0)]
    assert len(asked) > 500
    # Voxels are no points, and fade behind the surface: the expectation is a bound.
    assert 0.1 < np.median(asked) < 1.2


def test_the_error_of_a_place_grows_by_what_hair_turns_within_a_millimetre():
    pixel, turns = 0.0004, 150.0  # radians in a metre
    y, x = np.mgrid[:60, :80]
    hair = np.ones(x.shape, bool)
    hair[:, 70:] = False
    sigma = np.full(x.shape, 1.2 * SIGMA_SURE, np.float32)
    sure = np.where(hair, 1.0 / 1.2**2, 0.0).astype(np.float32)
    still = OrientationMap(np.full(x.shape, 0.7), sure, sigma)
    found = unsure_of_place(hair, still, pixel)
    np.testing.assert_allclose(found.sigma[hair], sigma[hair], rtol=1e-3)
    np.testing.assert_allclose(found.confidence, sure, rtol=3e-3)
    turning = OrientationMap((turns * pixel * x) % np.pi, sure, sigma)
    found = unsure_of_place(hair, turning, pixel)
    inner = slice(15, -15), slice(15, 55)
    expected = np.hypot(1.2 * SIGMA_SURE, turns * BESIDE)
    np.testing.assert_allclose(found.sigma[inner], expected, rtol=0.02)
    np.testing.assert_allclose(
        found.confidence[inner], (SIGMA_SURE / expected) ** 2, rtol=0.05
    )
    assert (found.confidence[~hair] == 0.0).all()


@pytest.mark.parametrize("spacing", [0.002, 0.006])
def test_one_voxel_decides_nothing_however_large_it_is(spacing):
    hull = hull_where(lambda p: p[:, 0] < 1, [0] * 3, [21 * spacing] * 3, spacing)
    near = np.ones(hull.hair.shape, bool)
    same = np.ones(near.size)
    odd = np.where(np.arange(near.size) == near.size // 2, 20.0, 1.0)
    found = ratio_around(hull, near, odd, same, same)
    # A voxel has this share of a Gaussian of two voxels.
    assert found.max() < 1.01 * (1.0 + 19.0 * (2.0 * np.pi * 2.0**2) ** -1.5)


@pytest.mark.parametrize(
    ("turned", "share", "agree"),
    [(1.0, 0.3, False), (0.7, 0.3, False), (0.3, 0.3, True), (0.3, 0.03, False)],
)
def test_directions_agree_where_they_contradict_much_less_in_enough_of_a_layer(
    turned, share, agree
):
    rng = np.random.default_rng(0)
    unlike = rng.random((20, 20, 20)) < share
    apart = np.where(unlike, turned, 1.0) * rng.uniform(0.9, 1.1, unlike.shape)
    found = Contradictions(apart, np.where(unlike, 4.0, 1.0))
    everywhere = np.ones(unlike.shape, bool)
    assert directions_agree(found, everywhere, unlike) == agree
    assert not directions_agree(found, ~everywhere, unlike)


@pytest.mark.parametrize(("layer", "cut"), [(0, False), (1, False), (2, True)])
def test_shades_cut_nothing_if_directions_agree_in_one_of_the_first_layers(
    hull, layer, cut
):
    # Shades differ in the upper half, layer after layer; where directions agree there,
    # that is hair. The lowest voxels contradict themselves by directions.
    height = all_centres(hull)[..., 1]
    lowest = hull.hair & (height == height[hull.hair].min())
    asked = []

    def ask(now):
        turned = np.where((height > 0.02) & (len(asked) == layer), 0.1, 1.0)
        asked.append(now)
        return Contradictions(
            np.where(lowest, 5.0, turned), np.where(height > 0.02, 40.0, 1.0)
        )

    gone = hull.hair & ~carve_layers(hull, ask).hair
    assert gone[lowest].all()
    assert gone[~lowest].any() == cut
    # It begins anew with all that the masks allow.
    assert cut or asked[layer + 1].hair.sum() == hull.hair.sum()


@pytest.mark.parametrize("wrong", [3.0, 20.0, 400.0])
def test_maps_that_contradict_each_other_everywhere_cut_nothing(hull, wrong):
    def ask(found):
        return Contradictions(
            np.where(found.hair, wrong, 0.0), np.ones(found.hair.shape)
        )

    np.testing.assert_array_equal(carve_layers(hull, ask).hair, hull.hair)


def test_a_wide_layer_goes_where_what_is_behind_it_agrees(hull):
    # A twentieth of what is behind disagrees as well, by chance.
    middles = hull.grid.centres(np.ones(hull.hair.shape, bool))
    away = np.linalg.norm(middles, axis=1).reshape(hull.hair.shape)
    odd = np.random.default_rng(0).random(hull.hair.shape) < 0.05

    def ask(found):
        return Contradictions(
            np.where((away > 0.056) | odd, 4.0, 0.5), np.ones(found.hair.shape)
        )

    left = carve_layers(hull, ask).hair
    assert not left[away > 0.056].any()
    assert left[away < 0.05].mean() > 0.8


def test_shades_that_nobody_compares_cut_nothing():
    nothing = np.zeros((4, 4, 4))
    everywhere = np.ones(nothing.shape, bool)
    assert usual_shade(Contradictions(nothing, nothing), everywhere) == np.inf
