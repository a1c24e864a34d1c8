import dataclasses

import numpy as np
import pytest
from ball_hair import ball, hull_where, ring, sphere_depth, view_of
from scipy import ndimage

from hairfit.fit.hull import GAPS, WIDER_GAPS, carve_sparse
from hairfit.fit.unexplained import share_unexplained, with_unexplained
from hairfit.render import mesh_depth

pytestmark = pytest.mark.usefixtures("small_room")

HAIR = 0.11


@pytest.fixture(scope="module")
def cameras():
    return ring(6)


@pytest.fixture(scope="module")
def views(cameras):
    """Photographs of a ball of hair."""
    return [view_of(c, np.isfinite(sphere_depth(c, HAIR)), "00") for c in cameras]


@pytest.fixture(scope="module")
def depths(cameras):
    return [mesh_depth(ball(), camera) for camera in cameras]


@pytest.fixture(scope="module")
def hull():
    size = HAIR + 0.01
    return hull_where(
        lambda p: (
            (np.linalg.norm(p, axis=1) < HAIR) & (np.linalg.norm(p, axis=1) > 0.1)
        ),
        [-size] * 3,
        [size] * 3,
        0.005,
    )


def test_hair_before_the_head_is_explained_or_not(hull, views, depths):
    none = np.zeros_like(hull.hair)
    none[hull.hair] = hull.grid.centres(hull.hair)[:, 1] > 0.0
    share = share_unexplained(hull.grid, hull.hair, views, depths)
    upper = share_unexplained(hull.grid, none, views, depths)
    assert share < 0.001
    # Around each voxel as much again is explained.
    assert 0.25 < upper < 0.5
    # One mask is wrong, of which nothing says so.
    wrong = [dataclasses.replace(views[0], hair=~views[0].hair), *views[1:]]
    assert share_unexplained(hull.grid, hull.hair, wrong, depths) < 0.001


def test_what_photographs_need_comes_back_and_nothing_else(hull, views, depths):
    points = hull.grid.centres(hull.hair)
    band = np.zeros_like(hull.hair)
    band[hull.hair] = np.abs(points[:, 1]) < 0.03
    # The outermost layer hides nothing: what is behind it explains as much.
    layer = hull.hair & ~np.asarray(ndimage.binary_erosion(hull.hair), bool)
    for gone, back in ((band, 0.5), (layer & ~band, 0.0)):
        left = hull.hair & ~gone
        found = with_unexplained(hull.grid, left, gone, views, depths)
        assert (found | hull.hair == hull.hair).all() and found[left].all()
        assert found[gone].mean() >= back
        if not back:
            assert found[gone].mean() < 0.05


def test_a_single_photograph_brings_nothing_back(hull, views, depths):
    gone = hull.hair
    none = np.zeros_like(gone)
    left = with_unexplained(hull.grid, none, gone, views[:1], depths[:1])
    assert not left.any()


def test_sparse_hair_is_carved_with_wider_gaps(cameras):
    head = ball()
    fine = ring(8, finer=4)
    depths = [mesh_depth(head, camera) for camera in fine]
    rng = np.random.default_rng(0)
    around = [np.isfinite(mesh_depth(ball(HAIR), camera)) for camera in fine]
    pixel = 0.5 / float(fine[0].K[0, 0])

    def wisps(camera, hair, depth):
        """Masks of hair that is everywhere, or of wisps 9 mm apart before the head."""
        before = np.isfinite(depth)
        seeds = rng.random(hair.shape) < (pixel / 0.009) ** 2
        wisp = np.asarray(ndimage.binary_dilation(seeds, iterations=1), bool)
        return view_of(camera, np.where(before, wisp & hair, hair), "00")

    whole = [view_of(c, hair, "00") for c, hair in zip(fine, around, strict=True)]
    sparse = [wisps(*one) for one in zip(fine, around, depths, strict=True)]
    assert carve_sparse(whole, depths, head, 0.008).gaps == GAPS
    assert carve_sparse(sparse, depths, head, 0.008).gaps in WIDER_GAPS
