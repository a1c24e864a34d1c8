import dataclasses

import numpy as np
import pytest
from known_hair import front_camera, lines, striped

from hairfit.evaluate import coverage
from hairfit.evaluate.coverage import (
    AS_WELL,
    TALL,
    WIDTHS,
    coarser,
    fit_width,
    hair_density,
    narrowest_width,
    overlaps,
)
from hairfit.evaluate.visibility import Sight
from hairfit.render.camera import resized

SIZE = 96


def test_a_strand_hides_its_length_times_its_width():
    camera = front_camera(SIZE, SIZE)
    strand = np.linspace([-0.02, 0.0, 0.0], [0.02, 0.0, 0.0], 5)[None]
    focal = float(camera.K[0, 0])
    depth = float(np.asarray(camera.cam_from_world)[2, 3])
    drawn = hair_density(strand, camera)
    # 40 mm of hair are so many pixels long, and a metre of width so many pixels wide.
    assert drawn.sum() == pytest.approx(0.04 * focal / depth * focal / depth, rel=1e-6)
    assert (drawn > 0.0).any(axis=1).sum() == 1


def test_parts_make_the_whole(monkeypatch):
    hair = square_of_hair(300, np.random.default_rng(3))
    whole = hair_density(hair, front_camera(SIZE, SIZE))
    monkeypatch.setattr(coverage, "AT_ONCE", 1000)
    parts = hair_density(hair, front_camera(SIZE, SIZE))
    assert whole.any() and np.allclose(parts, whole, rtol=1e-12)


def test_hair_beside_the_picture_hides_nothing():
    hair = square_of_hair(20, np.random.default_rng(4)) + [5.0, 0.0, 0.0]
    assert not hair_density(hair, front_camera(SIZE, SIZE)).any()


def test_what_stands_behind_the_head_hides_nothing():
    camera = front_camera(SIZE, SIZE)
    depth = float(np.asarray(camera.cam_from_world)[2, 3])
    wall = np.full((SIZE, SIZE), np.inf)
    wall[:, : SIZE // 2] = depth - 0.01
    drawn = hair_density(lines(0.0), camera, wall)
    assert not drawn[:, : SIZE // 2].any() and drawn[:, SIZE // 2 :].any()


def test_hair_that_lies_where_the_mask_says_covers_it_whatever_its_number():
    for count in (150, 1500):
        rng = np.random.default_rng(0)
        hair = square_of_hair(count, rng)
        found = fit_width(hair, [Sight(striped(0.0), None)])
        assert found.iou[0] > 0.9
        # So many strands as leave no gaps, wherever one comes to lie.
        assert 0.5 < found.width * count / 0.1 < 10.0


def test_single_hairs_beside_the_mask_cost_little():
    rng = np.random.default_rng(1)
    hair = square_of_hair(2000, rng)
    few = hair[:40].copy()
    few[..., 1] *= 1.4
    sight = Sight(striped(0.0), None)
    before = fit_width(hair, [sight]).iou[0]
    assert fit_width(np.concatenate([hair, few]), [sight]).iou[0] > before - 0.02
    wide = hair.copy()
    wide[..., 1] *= 1.4
    assert fit_width(wide, [sight]).iou[0] < before - 0.1


def test_a_mask_without_hair_is_covered_by_none():
    nothing = dataclasses.replace(striped(0.0), hair=np.zeros((SIZE, SIZE), bool))
    found = overlaps(lines(0.0) + 9.0, Sight(nothing, None), WIDTHS)
    assert (found == 1.0).all()


def test_wider_strands_cover_more():
    rng = np.random.default_rng(2)
    sight = Sight(striped(0.0), None)
    inside = overlaps(0.5 * square_of_hair(500, rng), sight, WIDTHS)
    assert (np.diff(inside) >= 0.0).all() and inside[0] == 0.0 and inside[-1] > 0.2


def test_hair_is_no_wider_than_masks_ask_for():
    # One short strand beside the others covers what it should once it is very wide.
    hair = 0.8 * square_of_hair(2000, np.random.default_rng(3))
    stray = hair[:1] * [0.6, 0.0, 1.0] + [0.0, 1.1 * hair[..., 1].max(), 0.0]
    hair = np.concatenate([hair, stray])
    sights = [Sight(striped(0.0), None)]
    best, found = fit_width(hair, sights), narrowest_width(hair, sights)
    assert found < 0.1 * best.width
    around = np.array([found / 1.1, found])
    too_thin, enough = overlaps(hair, sights[0], around)
    assert too_thin < best.iou[0] - AS_WELL <= enough < best.iou[0]
    twice = narrowest_width(np.concatenate([hair, hair]), sights)
    assert twice / found == pytest.approx(0.5, rel=WIDTHS[1] / WIDTHS[0] - 1.0)


def enlarged(view, times):
    """Return a view of so many times as many pixels a side, with the same mask."""
    mask, image = (
        part.repeat(times, axis=0).repeat(times, axis=1)
        for part in (view.hair, view.image)
    )
    camera = resized(view.camera, times * SIZE, times * SIZE)
    return dataclasses.replace(view, camera=camera, hair=mask, image=image)


def test_the_width_is_the_same_in_a_picture_of_more_pixels():
    view, hair = striped(0.0), square_of_hair(2000, np.random.default_rng(4))
    some, fine = enlarged(view, 3), enlarged(view, 15)
    assert 3 * SIZE < TALL < 15 * SIZE
    small = coarser(Sight(fine, np.arange(fine.hair.size).reshape(fine.hair.shape)))
    assert (small.view.hair == some.hair).all()
    # What hides hair is asked in the middle of each block of five pixels.
    assert small.behind is not None and small.behind[1, 2] == 7 * 15 * SIZE + 12
    few = hair[::10]
    widths = [narrowest_width(few, [Sight(one, None)]) for one in (some, fine)]
    assert widths[0] == widths[1]
    # Strands a tenth as many leave gaps in fine pixels that no width fills.
    assert fit_width(few, [Sight(fine, None)]).iou[0] < 0.5


def square_of_hair(count, rng):
    """Return level strands at random heights over the square of the mask."""
    camera = front_camera(SIZE, SIZE)
    depth = float(np.asarray(camera.cam_from_world)[2, 3])
    half = 32 * depth / float(camera.K[0, 0])
    strands = np.zeros((count, 5, 3))
    strands[..., 0] = np.linspace(-half, half, 5)
    strands[..., 1] = rng.uniform(-half, half, count)[:, None]
    return strands
