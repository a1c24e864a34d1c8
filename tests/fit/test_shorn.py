import dataclasses

import numpy as np
import pytest
from ball_hair import RADIUS, ball, hull_where, meridian, photograph, ring

from hairfit.fit.evidence import gather
from hairfit.fit.hull import hull_of
from hairfit.fit.shorn import find_shorn, streak_ends
from hairfit.fit.stubble import SHAVED, thin_hair
from hairfit.render import rasterise

SPACING = 0.003


def shell(height):
    """Return the hull of hair up to a height above the ball, a function of points."""
    size = RADIUS + 0.04

    def skin(points):
        return np.linalg.norm(points, axis=1) - RADIUS

    def hair(points):
        return (skin(points) > 0) & (skin(points) < height(points))

    return hull_where(hair, [-size] * 3, [size] * 3, SPACING, skin)


@pytest.fixture(scope="module")
def shorn():
    return shell(lambda points: np.where(points[:, 1] > 0.0, 0.008, 0.0))


def sums(ends, rng):
    """Return what is told of voxels, of some of which streaks end."""
    far = np.where(ends, rng.normal(0.0, 0.05, len(ends)), 0.15)
    return np.stack([np.full(len(ends), 0.3), far, np.ones(len(ends))], axis=1)


def shorn_in(hull, thin, told):
    return find_shorn(hull, streak_ends(hull, thin, told))


def test_thin_hair_has_no_high_hair_beside_it():
    fin = shell(lambda p: np.where(np.abs(p[:, 0]) < 0.02, 0.03, 0.008))
    away = np.abs(fin.grid.centres(fin.hair)[:, 0]) - 0.02
    thin = thin_hair(fin)
    assert not thin[away < 0.0].any() and thin[away > 0.014].all()
    assert thin[(away > 0.0) & (away < 0.003)].mean() < 0.5


@pytest.mark.parametrize("border", [0.05, 0.0, -0.05])
def test_hair_is_shorn_where_most_streaks_end(shorn, border):
    rng = np.random.default_rng(0)
    thin = thin_hair(shorn)
    x = shorn.grid.centres(shorn.hair)[:, 0]
    found = shorn_in(shorn, thin, sums(x < border, rng))
    # Places are two centimetres wide and more.
    assert found[x < border - 0.02].mean() > 0.95
    assert not found[x > border + 0.02].any()


def test_where_streaks_end_here_and_there_nothing_is_shorn(shorn):
    thin = thin_hair(shorn)
    at = shorn.grid.centres(shorn.hair)
    patches = np.floor(at[:, 0] / 0.03) % 2 == 0
    told = sums(patches, np.random.default_rng(0))
    ends = streak_ends(shorn, thin, told)
    assert ends.ends[ends.told].mean() > 0.3
    assert not find_shorn(shorn, ends).any()


def test_where_streaks_are_hardly_seen_nothing_is_shorn(shorn):
    rng = np.random.default_rng(0)
    thin = thin_hair(shorn)
    told = sums(thin, rng)
    assert shorn_in(shorn, thin, told)[thin].mean() > 0.95
    assert not shorn_in(shorn, thin, 0.0 * told).any()
    assert not shorn_in(shorn, thin, told * [0.1, 1.0, 1.0]).any()
    assert not shorn_in(shorn, thin, told * 0.05).any()


def test_a_little_shorn_hair_may_be_mistaken(shorn):
    at = shorn.grid.centres(shorn.hair)
    place = np.zeros_like(shorn.hair)
    place[shorn.hair] = np.linalg.norm(at - [0.0, RADIUS, 0.0], axis=1) < 0.025
    assert 0.0 < place.sum() * SPACING**3 < SHAVED
    little = hull_of(shorn.grid, place, shorn.head)
    thin = thin_hair(little)
    assert not shorn_in(little, thin, sums(thin, np.random.default_rng(0))).any()


def photographed(length, cameras):
    """Return photographs of strands so long that run down the ball, some bright."""
    rng = np.random.default_rng(0)
    count = round(80 / length)
    start = np.arccos(rng.uniform(0.0, 1.0, count))
    polar = start[:, None] + np.linspace(0.0, 1.0, 12) * length / RADIUS
    azimuth = rng.uniform(0.0, 2.0 * np.pi, (count, 1))
    strands = meridian(polar, azimuth, np.full(polar.shape, 0.004))
    grey = rng.uniform(0.1, 0.6, count)
    views, maps, depths = photograph(strands, cameras, ball(), radius_px=1.0)
    seen = []
    for view, depth in zip(views, depths, strict=True):
        drawn = rasterise(strands, view.camera, mesh_depth=depth, radius_px=1.0)
        image = np.repeat(grey[drawn.strand][..., None], 3, axis=2)
        seen.append(dataclasses.replace(view, image=image))
    return seen, maps, depths


@pytest.mark.parametrize("length, expected", [(0.008, True), (0.09, False)])
def test_photographs_tell_short_hair_that_lies_from_long(shorn, length, expected):
    told = gather(shorn, *photographed(length, ring(6, finer=5)))
    assert told.shorn is not None
    # A ring of cameras does not see the crown's hair from the side.
    side = shorn.grid.centres(shorn.hair)[:, 1] < 0.05
    assert told.shorn[side].mean() > 0.9 if expected else not told.shorn.any()


def test_where_streaks_go_on_there_is_no_stubble(shorn):
    views, maps, depths = photographed(0.09, ring(3, finer=5))
    faint = [dataclasses.replace(one, confidence=0.1 * one.confidence) for one in maps]
    even = [dataclasses.replace(view, image=0.0 * view.image) for view in views]
    # Each place is seen once, so that planes alone cannot tell.
    without, told = (gather(shorn, seen, faint, depths) for seen in (even, views))
    assert without.stubble is not None and without.stubble.mean() > 0.2
    assert told.stubble is not None and not told.stubble.any()


def test_beside_a_tail_stubble_is_where_streaks_end_and_not_where_none_are_seen(shorn):
    views, maps, depths = photographed(0.008, ring(3, finer=5))
    faint = [dataclasses.replace(one, confidence=0.1 * one.confidence) for one in maps]
    even = [dataclasses.replace(view, image=0.0 * view.image) for view in views]
    for seen, told in ((views, True), (even, False)):
        alone = gather(shorn, seen, faint, depths).stubble
        tied = gather(shorn, seen, faint, depths, tied=True).stubble
        assert alone is not None and tied is not None and alone.mean() > 0.2
        assert (tied == (alone if told else False)).all()
