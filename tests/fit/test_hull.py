import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import (
    RADIUS,
    ball,
    camera_at,
    hull_where,
    ring,
    sphere_depth,
    view_of,
)
from scipy import ndimage
from scipy.spatial import KDTree

from hairfit.capture.distance import signed_distance
from hairfit.errors import InputError
from hairfit.fit.grid import Grid
from hairfit.fit.hull import (
    GAPS,
    MASK_MARGIN,
    PACE,
    allowed_voxels,
    carve,
    first_hit,
    hull_of,
    walls_of,
    without_gaps,
)
from hairfit.render import Camera, mesh_depth
from hairfit.render.picture import points_at
from hairfit.render.raster import project_points

pytestmark = pytest.mark.usefixtures("small_room")

HAIR, SPACING = 0.11, 0.008  # a ball of hair around the head


def shots(cameras, radius=HAIR):
    """Return views of a ball of hair, as masks from the closed form."""
    return [
        view_of(c, np.isfinite(sphere_depth(c, radius)), f"{k:02d}")
        for k, c in enumerate(cameras)
    ]


@pytest.fixture(scope="module")
def head():
    return ball()


@pytest.fixture(scope="module")
def cameras():
    return ring(8)


@pytest.fixture(scope="module")
def depths(head, cameras):
    return [mesh_depth(head, camera) for camera in cameras]


@pytest.fixture
def hull(head, cameras, depths):
    return carve(shots(cameras), depths, head, SPACING)


def nearest_hair(camera, hair, point):
    """Return the distance in pixels from where a point lands to a pixel of hair."""
    pixel, _ = camera.project(jnp.asarray(point))
    rows, columns = np.nonzero(hair)
    there = np.floor(np.asarray(pixel)).astype(int)
    return np.max(np.abs(np.stack([columns, rows], 1) - there), axis=1).min()


def witnesses(points, cameras):
    """Count the cameras that see each point before the head, in closed form."""
    count = np.zeros(len(points), int)
    for camera in cameras:
        away = np.asarray(camera.centre) - points
        along = np.clip(-(points * away).sum(1) / (away**2).sum(1), 0, 1)
        nearest = np.linalg.norm(points + along[:, None] * away, axis=1)
        count += nearest > RADIUS
    return count


def test_the_hull_contains_the_hair_that_a_quarter_of_the_views_see(hull, cameras):
    points = hull.grid.centres(np.ones(hull.grid.shape, bool))
    away = np.linalg.norm(points, axis=1)
    hair = (away < HAIR) & (away > RADIUS + 0.001)
    seen = witnesses(1.02 * points, cameras) >= 3
    assert (hair & seen).sum() > 5000
    assert hull.hair.ravel()[hair & seen].all()


def test_the_hull_leaves_out_what_a_view_sees_as_background(hull, cameras):
    views = shots(cameras)
    points = hull.grid.centres(hull.hair)
    rng = np.random.default_rng(0)
    for point in points[rng.choice(len(points), 60, replace=False)]:
        for view in views:
            # The head's silhouette lies within the hair's: hidden is no excuse.
            assert nearest_hair(view.camera, view.hair, point) <= MASK_MARGIN


def test_the_hull_is_outside_the_head(hull, head):
    assert (signed_distance(head, hull.grid.centres(hull.hair)) > -0.001).all()


def test_distances_are_signed_and_to_the_border(hull, head):
    assert (hull.distance[hull.hair] < 0).all()
    assert (hull.distance[~hull.hair] > 0).all()
    outside = hull.grid.centres(~hull.hair)
    apart, _ = KDTree(hull.grid.centres(hull.hair)).query(outside)
    expected = apart - 0.5 * hull.grid.spacing
    assert np.allclose(hull.distance[~hull.hair], expected, atol=1e-9)
    near = np.abs(hull.distance) < 2 * SPACING
    exact = signed_distance(head, hull.grid.centres(near))
    assert np.allclose(hull.head[near], exact, atol=1e-9)


def test_a_picture_that_does_not_contain_the_hair_does_not_carve(head, cameras):
    six = ring(6)
    depths = [mesh_depth(head, camera) for camera in six]
    aside = camera_at([0.0, 0.1, 0.6], target=[5.0, 0.1, 0.6])
    nothing = view_of(aside, np.zeros((aside.height, aside.width), bool), "aside")
    before = carve(shots(six), depths, head, SPACING)
    after = carve(
        [*shots(six), nothing], [*depths, mesh_depth(head, aside)], head, SPACING
    )
    one, other = (hull.grid.centres(hull.hair) for hull in (before, after))
    assert np.allclose(one, other, atol=1e-12)


@pytest.mark.parametrize(
    ("columns", "allowed"),
    [((40, 80), False), ((0, 128), True), ((0, 80), "left"), ((40, 128), "right")],
)
def test_beyond_a_picture_hair_goes_on_where_it_reaches_the_border(columns, allowed):
    front, side = camera_at([0.0, 0.0, 0.6]), camera_at([0.6, 0.0, 0.0])
    mask = np.zeros((side.height, side.width), bool)
    mask[:, slice(*columns)] = True
    views = [view_of(front, np.ones_like(mask)), view_of(side, mask)]
    # One place beyond each border of the second picture, which is 0.48 m wide there.
    grid = Grid.around(
        np.array([-0.01, -0.01, -0.3]), np.array([0.01, 0.01, 0.3]), 0.02
    )
    open_sight = [np.full(mask.shape, np.inf)] * 2
    found = allowed_voxels(grid, np.ones(grid.shape, bool), views, open_sight, 0.0)
    column, _ = project_points(np.array([[0.0, 0.0, -0.29]]), side).pixel[0]
    ends = found[0, 0, [0, -1]] if column < 0 else found[0, 0, [-1, 0]]
    assert ends.tolist() == [allowed in (True, "left"), allowed in (True, "right")]


@pytest.mark.parametrize(
    ("eyes", "columns", "allowed"),
    [
        ([[0.0, 0.0, 0.6]], (0, 128), False),
        ([[0.0, 0.0, 0.6], [0.0, 0.0, -0.9]], (0, 128), False),
        ([[0.0, 0.0, 0.6], [0.0, 0.9, -0.28]], (0, 128), True),
        ([[0.0, 0.0, 0.6], [0.0, 0.9, -0.28]], (40, 80), False),
    ],
    ids=["one view", "one outline", "two outlines", "a border without hair"],
)
def test_two_outlines_overrule_a_border_that_cuts_hair_off(eyes, columns, allowed):
    side = camera_at([0.6, 0.0, 0.0])
    everywhere = np.ones((side.height, side.width), bool)
    # Hair goes on beyond the border, but farther up.
    mask = np.zeros_like(everywhere)
    mask[:30, slice(*columns)] = True
    place = np.array([0.0, 0.0, -0.29])
    column, row = project_points(place[None], side).pixel[0]
    assert not 0 < column < side.width and 40 < row < 80
    targets = [[0.0, 0.0, 0.0] if eye[1] == 0.0 else [0.0, 0.0, -0.29] for eye in eyes]
    others = [camera_at(eye, at) for eye, at in zip(eyes, targets, strict=True)]
    views = [view_of(side, mask), *(view_of(one, everywhere) for one in others)]
    grid = Grid.around(place - 0.005, place + 0.005, 0.01)
    open_sight = [np.full(mask.shape, np.inf)] * len(views)
    found = allowed_voxels(grid, np.ones(grid.shape, bool), views, open_sight, 0.0)
    assert found.all() == allowed and found.any() == allowed


def test_one_view_is_enough_where_all_others_look_from_the_other_side(head, cameras):
    half = cameras[:5]
    hull = carve(shots(half), [mesh_depth(head, c) for c in half], head, SPACING)
    points = hull.grid.centres(np.ones(hull.grid.shape, bool))
    away = np.linalg.norm(points, axis=1)
    hair = (away < HAIR) & (away > RADIUS + 0.001)
    count = witnesses(1.02 * points, half)
    for end in (half[0], half[4]):
        alone = hair & (witnesses(0.98 * points, [end]) == 1) & (count == 1)
        assert alone.sum() > 10
        assert hull.hair.ravel()[alone].all()
    assert not hull.hair.ravel()[hair & (count == 0)].any()


def test_two_of_eight_views_must_see_hair_not_the_head_before_it(cameras, head):
    views = shots(cameras)
    hidden = np.zeros_like(views[0].hair, float)
    open_sight = np.full_like(hidden, np.inf)
    with pytest.raises(InputError, match="no place in space lies inside all hair"):
        carve(views, [open_sight] + [hidden] * 7, head, SPACING)
    hull = carve(views, [open_sight, hidden, open_sight] + [hidden] * 5, head, SPACING)
    assert hull.hair.any()


def test_masks_that_contradict_each_other_are_refused(head, cameras, depths):
    views = shots(cameras)
    left = np.zeros_like(views[0].hair)
    left[:5, :5] = True
    views[3] = dataclasses.replace(views[3], hair=left)
    free = [np.full_like(depth, np.inf) for depth in depths]
    with pytest.raises(InputError, match="inside all hair masks|leave no room"):
        carve(views, free, head, SPACING)


def test_hair_that_lies_in_the_head_is_refused(head, cameras, depths):
    free = [np.full_like(depth, np.inf) for depth in depths]
    with pytest.raises(InputError, match="leave no room for hair outside the head"):
        carve(shots(cameras, 0.05), free, head, SPACING)


def test_the_grid_is_made_coarser_where_memory_asks_for_it(
    head, cameras, depths, monkeypatch
):
    monkeypatch.setattr("hairfit.fit.hull.MOST_VOXELS", 2000)
    hull = carve(shots(cameras), depths, head, SPACING)
    assert hull.hair.sum() <= 2000
    assert hull.grid.spacing > SPACING


def test_first_hits_are_where_rays_meet_a_ball():
    spacing, radius = 0.004, 0.1
    camera = camera_at([0.2, 0.1, 0.5])
    hull = hull_where(
        lambda p: np.linalg.norm(p, axis=1) < radius, [-0.12] * 3, [0.12] * 3, spacing
    )
    hair = np.isfinite(sphere_depth(camera, radius))
    found = first_hit(walls_of(hull), view_of(camera, hair), step=1)
    assert np.array_equal(np.isfinite(found) & ~hair, np.zeros_like(hair))
    # Rays that graze the ball meet the voxels' corners.
    facing = np.isfinite(sphere_depth(camera, 0.7 * radius))
    error = found[facing] - sphere_depth(camera, radius)[facing]
    assert np.abs(error).max() < 2 * spacing
    assert np.abs(np.median(error)) < 0.7 * spacing


def test_rays_miss_nothing_where_they_skip_what_is_empty():
    spacing = 0.008
    noise = np.random.default_rng(3).normal(size=(30, 30, 30))
    lumps = ndimage.gaussian_filter(noise, 1.5) > 0.14
    grid = Grid(np.full(3, -0.12), spacing, lumps.shape)
    hull = hull_of(grid, lumps, np.full(lumps.shape, 0.02))
    camera = camera_at([0.2, 0.1, 0.3])
    everywhere = np.ones((camera.height, camera.width), bool)
    found = first_hit(walls_of(hull), view_of(camera, everywhere), step=1)
    # Every ray, looked at wherever it was asked, one depth after the other.
    seen = project_points(grid.centres(lumps), camera).depth
    near, far = seen.min() - spacing, seen.max()
    expected = np.full(found.shape, np.inf)
    for depth in np.arange(near, far, PACE * spacing):
        voxel = grid.voxel(
            points_at(camera, np.full(found.shape, depth)).reshape(-1, 3)
        )
        struck = grid.inside(voxel)
        struck[struck] = lumps[tuple(voxel[struck].T)]
        expected[struck.reshape(found.shape) & np.isinf(expected)] = depth
    assert 0.2 < np.isfinite(found).mean() < 0.9
    assert np.mean(found == expected) > 0.999  # points on the border of two voxels


def test_first_hits_of_blocks_are_those_of_their_middles():
    camera = camera_at([0.0, 0.0, 0.5])
    hull = hull_where(
        lambda p: np.linalg.norm(p, axis=1) < 0.1, [-0.12] * 3, [0.12] * 3, 0.006
    )
    shrink = jnp.diag(jnp.array([0.5, 0.5, 1.0]))
    half = Camera(shrink @ camera.K, camera.cam_from_world, 64, 64)
    hair = np.zeros((camera.height, camera.width), bool)
    hair[50:70, 40:60] = True
    hair[20, 31] = True
    found = first_hit(walls_of(hull), view_of(camera, hair), step=2)
    small = hair.reshape(64, 2, 64, 2).any(axis=(1, 3))
    expected = first_hit(walls_of(hull), view_of(half, small), step=1)
    assert np.allclose(found, expected, atol=1e-9)
    assert np.isinf(found[~small]).all()


def test_skin_that_shows_between_hairs_is_no_gap_but_a_parting_is(head):
    camera = ring(1, finer=4)[0]
    depth = mesh_depth(head, camera)
    hair = np.isfinite(mesh_depth(ball(HAIR), camera))
    spots = np.random.default_rng(0).random(hair.shape) < 0.1
    parting = np.zeros_like(hair)
    middle = camera.width // 2
    parting[: camera.height // 2, middle - 8 : middle + 8] = True
    pixel = float(depth[np.isfinite(depth)].mean()) / float(camera.K[0, 0])
    assert 16 * pixel > 3 * 2 * GAPS > 6 * pixel
    closed = without_gaps(view_of(camera, hair & ~spots & ~parting), depth).hair
    skin = np.isfinite(depth)
    rows = np.flatnonzero((skin & hair & parting)[:, middle])
    assert len(rows) > 50 and not closed[rows, middle].any()
    away = ~np.asarray(ndimage.binary_dilation(parting, iterations=12), bool)
    inner = np.asarray(ndimage.binary_erosion(hair, iterations=8), bool)
    assert closed[skin & inner & away].all()
    assert (closed == (hair & ~spots & ~parting))[~skin].all()


def test_small_gaps_in_masks_carve_little_of_the_hair_before_the_head(
    head, monkeypatch
):
    cameras = ring(8, finer=4)
    depths = [mesh_depth(head, camera) for camera in cameras]
    around = ball(HAIR)
    whole = [view_of(c, np.isfinite(mesh_depth(around, c))) for c in cameras]

    def spotted(view):
        y, x = np.indices(view.hair.shape) % 10
        return dataclasses.replace(view, hair=view.hair & ((y > 3) | (x > 3)))

    same = carve(whole, depths, head, SPACING)
    thin = same.hair & (same.head < 0.012) & (same.head > 0)
    given = [spotted(view) for view in whole], depths, head, SPACING
    lost = 1.0 - carve(*given).hair[thin].mean()
    monkeypatch.setattr("hairfit.fit.hull.GAPS", 0.0)
    # What is lost still is hair that a view sees beside the head.
    assert lost < 0.6 * (1.0 - carve(*given).hair[thin].mean())


def test_a_photograph_without_the_head_keeps_its_gaps():
    camera = camera_at([0.0, 0.0, 0.6])
    view = view_of(camera, np.random.default_rng(0).random((128, 128)) > 0.2)
    assert without_gaps(view, np.full((128, 128), np.inf)) is view


def test_distances_are_linear_between_voxels_and_infinite_beyond():
    deep = 0.02
    hull = hull_where(
        lambda p: p[:, 1] < deep, [-0.02, 0.0, -0.02], [0.02, 0.04, 0.02], 0.002
    )
    heights = np.linspace(0.003, 0.037, 40)
    points = np.stack([np.full(40, 0.0071), heights, np.full(40, -0.013)], axis=1)
    assert np.allclose(hull.distance_at(points), heights - deep)
    assert np.isinf(
        hull.distance_at(np.array([[0.0, 0.041, 0.0], [0.1, 0.02, 0.0]]))
    ).all()
