import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hairfit.render import (
    Camera,
    mesh_depth,
    mesh_hits,
    project_points,
    rasterise,
    visible_points,
)
from hairfit.render.raster import rasterise_wider
from hairfit.types import Mesh

FOCAL, WIDTH, HEIGHT = 100.0, 64, 48


@pytest.fixture
def camera():
    """Looks along +z from the origin, with the axis through the picture's centre."""
    K = jnp.array([[FOCAL, 0.0, WIDTH / 2], [0.0, FOCAL, HEIGHT / 2], [0.0, 0.0, 1.0]])
    return Camera(K, jnp.eye(4), WIDTH, HEIGHT)


def unproject(x, y, z):
    """Return the point of the fixture's camera at a pixel and a depth."""
    return [(x - WIDTH / 2) / FOCAL * z, (y - HEIGHT / 2) / FOCAL * z, z]


def square(z, half):
    corner = np.array([[-half, -half, z], [half, -half, z], [half, half, z]])
    corner = np.concatenate([corner, [[-half, half, z]]])
    return Mesh(corner, np.array([[0, 1, 2], [0, 2, 3]]))


def test_projection_is_the_cameras(camera):
    p = np.array([[0.1, -0.2, 1.5], [0.0, 0.3, -1.0], [0.3, 0.1, 2.0]])
    pixels = project_points(p, camera)
    for i, one in enumerate(p):
        expected = camera.project(jnp.asarray(one))
        assert np.allclose(pixels.pixel[i], expected.pixel, atol=1e-12)
        assert np.allclose(pixels.depth[i], expected.depth, atol=1e-12)


def test_a_level_strand_covers_one_row_and_no_more(camera):
    strand = np.array([[unproject(10.5, 20.5, 1.0), unproject(30.5, 20.5, 1.0)]])
    raster = rasterise(strand, camera)
    expected = np.zeros((HEIGHT, WIDTH), bool)
    expected[20, 10:31] = True
    assert (raster.coverage == expected).all()
    assert (raster.strand == np.where(expected, 0, -1)).all()
    assert np.allclose(raster.depth[expected], 1.0, atol=1e-6)
    assert np.isinf(raster.depth[~expected]).all()
    assert np.allclose(raster.orientation, 0.0, atol=1e-12)


def test_depth_along_a_segment_is_true_to_perspective(camera):
    strand = np.array([[unproject(5.5, 20.5, 0.5), unproject(55.5, 20.5, 2.0)]])
    raster = rasterise(strand, camera, step_px=0.05)
    column = np.arange(5, 56)
    share = (column - 5) / 50.0
    expected = 1.0 / ((1 - share) / 0.5 + share / 2.0)
    # A pixel keeps its nearest sample: half a pixel towards the near end.
    assert np.all(raster.depth[20, column] <= expected + 1e-6)
    assert np.all(raster.depth[20, column[1:]] >= expected[:-1] - 1e-6)


@settings(deadline=None, max_examples=30)
@given(st.floats(-3.1, 3.1))
def test_orientation_turns_from_x_towards_y_and_has_no_sign(angle):
    K = jnp.array([[FOCAL, 0.0, WIDTH / 2], [0.0, FOCAL, HEIGHT / 2], [0.0, 0.0, 1.0]])
    camera = Camera(K, jnp.eye(4), WIDTH, HEIGHT)
    end = unproject(32 + 15 * np.cos(angle), 24 + 15 * np.sin(angle), 1.0)
    raster = rasterise(np.array([[unproject(32, 24, 1.0), end]]), camera)
    found = raster.orientation[raster.coverage]
    assert ((found >= 0.0) & (found < np.pi)).all()
    assert np.allclose(np.exp(2j * found), np.exp(2j * angle), atol=1e-9)


def test_the_nearer_strand_wins_whatever_the_order(camera):
    level = [unproject(10.5, 24.5, 1.0), unproject(50.5, 24.5, 1.0)]
    upright = [unproject(30.5, 5.5, 0.9), unproject(30.5, 40.5, 0.9)]
    for first, second, front in ((level, upright, 1), (upright, level, 0)):
        raster = rasterise(np.array([first, second]), camera)
        assert raster.strand[24, 30] == front
        assert raster.depth[24, 30] == pytest.approx(0.9, abs=1e-6)
        assert raster.orientation[24, 30] == pytest.approx(np.pi / 2)
        assert raster.strand[24, 31] == 1 - front


def test_a_pixel_knows_the_segment_it_shows(camera):
    knots = [unproject(x, 24.5, 1.0) for x in (10.0, 20.0, 30.0, 40.0)]
    raster = rasterise(np.array([knots]), camera)
    for column, segment in ((15, 0), (25, 1), (35, 2)):
        assert raster.segment[24, column] == segment
    assert (raster.segment[~raster.coverage] == -1).all()


def test_a_ray_knows_the_face_it_meets(camera):
    hits = mesh_hits(square(1.0, 0.1), camera)
    assert hits.face[15, 38] == 0  # above the diagonal from the first corner
    assert hits.face[32, 24] == 1
    assert hits.face[0, 0] == -1


def test_among_equals_the_first_strand_wins(camera):
    strand = [unproject(10.5, 24.5, 1.0), unproject(50.5, 24.5, 1.0)]
    raster = rasterise(np.array([strand, strand, strand]), camera)
    assert set(raster.strand[raster.coverage]) == {0}


def test_the_head_hides_hair_behind_it_and_none_before_it(camera):
    strands = np.array(
        [
            [unproject(5.5, 20.5, 1.2), unproject(60.5, 20.5, 1.2)],
            [unproject(5.5, 30.5, 0.8), unproject(60.5, 30.5, 0.8)],
        ]
    )
    depth = mesh_depth(square(1.0, 0.1), camera)  # 20 pixels wide about the centre
    raster = rasterise(strands, camera, mesh_depth=depth)
    assert not raster.coverage[20, 22:42].any()
    assert raster.coverage[20, 5:22].all()
    assert raster.coverage[20, 42:61].all()
    assert raster.coverage[30, 5:61].all()


def test_mesh_depth_runs_along_the_axis_and_not_along_the_ray(camera):
    depth = mesh_depth(square(1.0, 0.1), camera)
    assert np.allclose(depth[14:34, 22:42], 1.0, atol=1e-6)
    outside = np.ones_like(depth, bool)
    outside[14:34, 22:42] = False
    assert np.isinf(depth[outside]).all()


def test_a_mesh_beside_the_picture_or_behind_the_camera_has_no_depth(camera):
    beside = square(1.0, 0.1)
    beside = Mesh(beside.vertices + [5.0, 0.0, 0.0], beside.faces)
    assert np.isinf(mesh_depth(beside, camera)).all()
    assert np.isinf(mesh_depth(square(-1.0, 0.1), camera)).all()


def test_a_moved_camera_sees_the_same(camera):
    rng = np.random.default_rng(0)
    angle = 0.7
    view = np.eye(4)
    view[:3, :3] = [
        [np.cos(angle), 0, np.sin(angle)],
        [0, 1, 0],
        [-np.sin(angle), 0, np.cos(angle)],
    ]
    view[:3, 3] = [0.1, -0.2, 0.3]
    moved = Camera(camera.K, jnp.asarray(view), WIDTH, HEIGHT)
    p_cam = rng.uniform([-0.2, -0.1, 0.8], [0.2, 0.1, 1.2], (20, 4, 3))
    p_world = (p_cam - view[:3, 3]) @ view[:3, :3]
    here, there = rasterise(p_cam, camera), rasterise(p_world, moved)
    assert (here.strand == there.strand).mean() > 0.995  # rounding at pixel borders
    mesh = square(1.0, 0.1)
    turned = Mesh((mesh.vertices - view[:3, 3]) @ view[:3, :3], mesh.faces)
    same = mesh_depth(turned, moved)
    inner = (slice(15, 33), slice(23, 41))
    assert np.allclose(same[inner], 1.0, atol=1e-6)


def test_a_radius_widens_every_strand(camera):
    strand = np.array([[unproject(10.5, 20.5, 1.0), unproject(30.5, 20.5, 1.0)]])
    raster = rasterise(strand, camera, radius_px=2.0)
    rows = np.where(raster.coverage[:, 20])[0]
    assert rows.tolist() == [18, 19, 20, 21, 22]
    columns = np.where(raster.coverage[20])[0]
    assert columns.tolist() == list(range(8, 33))


def test_strands_are_as_wide_as_each_radius_says_drawn_together_or_alone(camera):
    rng = np.random.default_rng(1)
    strands = rng.normal(0.0, 0.3, (30, 5, 3)) + np.array([0.0, 0.0, 1.5])
    radii = (0.0, 1.0, 2.5)
    together = list(rasterise_wider(strands, camera, radii))
    for radius, found in zip(radii, together, strict=True):
        alone = rasterise(strands, camera, radius_px=radius)
        assert all(map(np.array_equal, found, alone))
    covered = [one.coverage.sum() for one in together]
    assert 0 < covered[0] < covered[1] < covered[2]


def test_hair_beside_and_behind_the_camera_leaves_no_trace(camera):
    strands = np.array(
        [
            [[0.0, 0.0, -1.0], [0.1, 0.0, -1.0]],  # behind
            [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]],  # through the camera
            [[5.0, 0.0, 1.0], [6.0, 0.0, 1.0]],  # beside
            [[-1e9, 1e9, 1.0], [1e9, 1e9, 1.0]],  # far beside
        ]
    )
    raster = rasterise(strands, camera)
    assert not raster.coverage.any()
    assert (raster.strand == -1).all()


def test_a_strand_right_before_the_camera_is_clipped_to_the_picture(camera):
    strand = np.array([[[-1e4, 0.001, 0.01], [1e4, 0.001, 0.01]]])
    raster = rasterise(strand, camera)
    assert raster.coverage.sum() == WIDTH
    assert raster.coverage[34].all()


def test_no_strands_give_an_empty_picture(camera):
    raster = rasterise(np.zeros((0, 5, 3)), camera)
    assert not raster.coverage.any()


def test_the_same_strands_give_the_same_bytes(camera):
    rng = np.random.default_rng(1)
    p = rng.uniform([-0.3, -0.2, 0.8], [0.3, 0.2, 1.2], (300, 5, 3))
    first, second = rasterise(p, camera), rasterise(p, camera)
    for one, two in zip(first, second, strict=True):
        assert one.tobytes() == two.tobytes()


def test_points_are_seen_up_to_the_tolerance_and_a_footprint_behind_hair(camera):
    depth = np.full((HEIGHT, WIDTH), np.inf)
    depth[:, :32] = 1.0
    head = np.full((HEIGHT, WIDTH), np.inf)
    head[24:] = 1.05
    z = np.array([0.9, 1.001, 1.011, 1.014, 1.2])  # the footprint is 0.01
    left = np.array([unproject(10.5, 10.5, one) for one in z])
    seen = visible_points(left, camera, depth, head, 0.002)
    assert seen.tolist() == [True, True, True, False, False]
    right = np.array([unproject(40.5, 40.5, one) for one in (1.0, 1.05, 1.07)])
    seen = visible_points(right, camera, depth, head, 0.002)
    assert seen.tolist() == [True, True, False]
    assert visible_points(right, camera, depth, None, 0.002).all()


def test_points_beside_the_picture_or_behind_the_camera_are_not_seen(camera):
    depth = np.full((HEIGHT, WIDTH), np.inf)
    p = np.array([unproject(-0.1, 10, 1.0), unproject(10, 48.1, 1.0), [0, 0, -1.0]])
    assert not visible_points(p, camera, depth, None, 1.0).any()
