import dataclasses

import numpy as np
import pytest
from ball_hair import (
    ball,
    camera_at,
    comb,
    every_root,
    hair_of,
    photograph,
    ring,
    texels_at,
    view_of,
)
from scipy import sparse

from hairfit.evaluate.coverage import hair_density, narrowest
from hairfit.evaluate.visibility import Sight
from hairfit.fit.density import TEXELS
from hairfit.fit.thinning import (
    BLOCK,
    THINNEST,
    Covers,
    cover_by_width,
    covers,
    root_density,
    strand_factors,
    thinned,
    width_of,
)
from hairfit.model.maps import even_maps
from hairfit.model.strand import Hair

CAMERA = camera_at([0.0, 0.1, 0.6])
EVEN = even_maps(TEXELS, TEXELS)


def seen(strands):
    """Return photographs of the ball with strands on it."""
    found = photograph(strands, ring(8), ball())
    return [Sight(*one) for one in zip(found.views, found.depths, strict=True)]


def test_blocks_hold_what_their_pixels_do():
    strands = comb(every_root(40, np.random.default_rng(0))[0])
    hair = np.zeros((CAMERA.height, CAMERA.width), bool)
    hair[:64, :31] = True
    found = covers(strands, Sight(view_of(CAMERA, hair), None))
    drawn = hair_density(strands, CAMERA)
    rows, columns = drawn.shape[0] // BLOCK, drawn.shape[1] // BLOCK
    blocks = drawn.reshape(rows, BLOCK, columns, BLOCK).mean(axis=(1, 3))
    total = np.asarray(found.hides.sum(axis=0)).reshape(rows, columns)
    assert total.any() and np.allclose(total, blocks)
    # A block of which half is hair counts as hair.
    assert found.wanted.sum() == 32 * 16
    tenth = hair_density(strands[10:11], CAMERA).sum() / BLOCK**2
    assert found.hides[10].sum() == pytest.approx(tenth)


def test_pictures_of_odd_sizes_keep_their_last_pixels():
    side = CAMERA.width - 1
    camera = dataclasses.replace(CAMERA, width=side, height=side)
    strands = comb(every_root(40, np.random.default_rng(0))[0])
    # Nearer, so that strands run out of the picture.
    found = covers(
        2.5 * strands, Sight(view_of(camera, np.ones((side, side), bool)), None)
    )
    whole = hair_density(2.5 * strands, camera).sum() / BLOCK**2
    assert found.hides.sum() == pytest.approx(whole)
    assert len(found.wanted) == (CAMERA.width // BLOCK) ** 2


def alone(amounts, wanted):
    """Return a picture in which each strand hides a block of its own so much."""
    return Covers(sparse.csr_matrix(np.diag(amounts)), np.asarray(wanted))


def test_strands_beside_the_hair_count_for_as_little_as_it_takes():
    # Hair hides its pixels ten times as much as what is beside it, one strand nothing.
    amounts = np.repeat([1e4, 1e3, 2e4, 0.0], [60, 30, 10, 1])
    wanted = np.repeat([True, False, False, False], [60, 30, 10, 1])
    factor = strand_factors([alone(amounts, wanted)] * 2)
    hair, faint, wrong, unseen = np.split(factor, [60, 90, 100])
    assert (hair == 1.0).all() and (faint == 1.0).all() and (unseen == 1.0).all()
    # Hidden by half, as hair of the width is, is what no pixel beside hair may be.
    assert np.allclose(wrong, 0.5, rtol=0.1)


def test_hair_that_is_too_thin_counts_for_more():
    # To hide the thin hair as well, strands would be so wide that half is too much.
    amounts = np.repeat([1e4, 1e3, 5e3], [100, 40, 100])
    wanted = np.repeat([True, True, False], [100, 40, 100])
    hair, thin, _ = np.split(strand_factors([alone(amounts, wanted)]), [100, 140])
    assert (hair == 1.0).all() and np.allclose(thin, 10.0, rtol=0.1)


def test_even_factors_leave_every_root():
    _, uv = every_root(3000, np.random.default_rng(2))
    assert (root_density(uv, np.full(3000, 0.37)) == 1.0).all()


def test_density_follows_the_factors():
    _, uv = every_root(6000, np.random.default_rng(3))
    left = uv[:, 0] < 0.5
    found = root_density(uv, np.where(left, 0.2, 1.0))
    far = np.abs(uv[:, 0] - 0.5) > 0.1
    # Half of the densest is dense enough.
    assert texels_at(found, uv[left & far]) == pytest.approx(0.4, abs=0.02)
    assert (texels_at(found, uv[~left & far]) == 1.0).all()
    none = root_density(uv, np.where(left, 0.0, 1.0))
    assert texels_at(none, uv[left & far]) == pytest.approx(THINNEST)
    # Nothing is known of a scalp without roots.
    assert found[0, 0] == 1.0


def test_roots_stay_where_photographs_show_hair():
    rng = np.random.default_rng(4)
    roots, uv = every_root(3000, rng)
    there = roots[:, 0] > 0.0
    hair = hair_of(roots, uv)
    density = np.asarray(
        thinned(EVEN, hair, seen(np.asarray(hair.strands)[there])).density
    )
    far = np.abs(roots[:, 0]) > 0.015
    assert np.mean(texels_at(density, uv[there & far])) > 0.97
    assert np.mean(texels_at(density, uv[~there & far])) < 0.25
    assert density.min() >= THINNEST and density.max() <= 1.0


def test_a_tree_that_grows_nothing_is_left_to_who_draws_it():
    roots, uv = every_root(3, np.random.default_rng(6))
    sights = seen(comb(roots))
    nothing = Hair(*(leaf[:0] for leaf in hair_of(roots, uv)))
    assert (thinned(EVEN, nothing, sights).density == 1.0).all()


def test_hair_that_explains_its_masks_stays_as_it_is():
    roots, uv = every_root(3000, np.random.default_rng(5))
    hair = hair_of(roots, uv)
    even = even_maps(TEXELS, TEXELS, curl=0.004)
    maps = thinned(even, hair, seen(np.asarray(hair.strands)))
    assert np.mean(texels_at(np.asarray(maps.density), uv)) > 0.98
    assert (maps.length == 1.0).all() and (maps.curl == even.curl).all()


def test_strands_are_no_wider_than_masks_need_them():
    # One block of two hundred is hardly met: ten times as wide strands would hide it.
    hides = np.full((1, 200), 1000.0)
    hides[0, 0] = 100.0
    seen = [Covers(sparse.csr_matrix(hides), np.ones(200, bool))]
    least = np.log(2.0) / 1000.0
    found = narrowest(cover_by_width(seen, np.ones(1)))
    assert least <= found < 1.2 * least < width_of(seen, np.ones(1))
