import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import RADIUS, hull_where, ring, sphere_depth, view_of

from hairfit.capture import load_capture
from hairfit.fit.bridges import bridged, pieces_of, shown_alone
from hairfit.fit.hull import carve, rooted_pieces
from hairfit.model.scalp import points_on, sample_roots
from hairfit.render import mesh_depth
from hairfit.render.raster import project_points
from hairfit.synthetic.head import make_head, make_scalp
from hairfit.synthetic.scene import Scene, write_capture
from hairfit.synthetic.styles import make_style

CAP = 0.095  # radius of the hair on the ball
CAMERAS = ring(8)
ROOTS = np.array([[0.0, RADIUS, 0.0], [0.0, 0.0, -RADIUS]])


def hull_with(centre, radius):
    """Return a cap of hair on the ball, and a ball of hair apart."""

    def inside(points):
        reach = np.linalg.norm(points, axis=1)
        apart = np.linalg.norm(points - centre, axis=1) < radius
        return (reach > RADIUS) & (reach < CAP) & (points[:, 1] > -0.02) | apart

    def skin(points):
        return np.linalg.norm(points, axis=1) - RADIUS

    return hull_where(inside, [-0.13, -0.13, -0.27], [0.13, 0.13, 0.13], 0.005, skin)


def views_of(*balls, cameras=CAMERAS):
    """Return views whose masks show balls, each a centre and a radius."""
    shown = []
    for camera in cameras:
        masks = []
        for centre, radius in balls:
            move = np.eye(4)
            move[:3, 3] = centre
            pose = jnp.asarray(camera.cam_from_world @ move)
            moved = type(camera)(camera.K, pose, camera.width, camera.height)
            masks.append(np.isfinite(sphere_depth(moved, radius)))
        shown.append(view_of(camera, np.any(masks, axis=0)))
    return shown


HEAD = (np.zeros(3), CAP)
TAIL = (np.array([0.0, 0.0, -0.15]), 0.03)


def test_a_tail_apart_hangs_on_the_head_by_a_bridge():
    hull = hull_with(*TAIL)
    found = bridged(hull, ROOTS, views_of(HEAD, TAIL))
    assert pieces_of(hull.hair).max() == 2
    assert pieces_of(found.hair).max() == 1
    assert not (hull.hair & ~found.hair).any()
    added = found.grid.centres(found.hair & ~hull.hair)
    # All free places whose way to both is at most 12 mm longer than the gap of 25 mm.
    air = hull.grid.centres(~hull.hair & (hull.head > 0.0))
    added, air = added[added[:, 1] > 0.0], air[air[:, 1] > 0.0]

    def way(points):
        to_cap = np.linalg.norm(points, axis=1) - CAP
        return to_cap + np.linalg.norm(points - TAIL[0], axis=1) - TAIL[1]

    voxel = hull.grid.spacing
    assert np.all(way(added) < 0.025 + 0.012 + voxel)
    inside = air[way(air) < 0.025 + 0.012 - 2 * voxel]
    assert len(inside) > 30
    assert set(map(tuple, inside)) <= set(map(tuple, added))
    # Its distances are those of the new border.
    assert np.all(found.distance[found.hair] < 0.0)


def test_no_bridge_leads_through_the_head():
    hull = hull_with(*TAIL)
    wall = np.where(hull.grid.centres(hull.hair | True)[:, 0] > 0.0, -0.01, 0.02)
    head = np.minimum(hull.head, wall.reshape(hull.grid.shape))
    walled = type(hull)(hull.grid, hull.hair, hull.distance, head)
    found = bridged(walled, ROOTS, views_of(HEAD, TAIL))
    added = found.grid.centres(found.hair & ~hull.hair)
    assert len(added) and np.all(added[:, 0] <= 0.0)


@pytest.mark.parametrize(
    ("tail", "masks"),
    [
        # Where views happen to meet: the head alone explains their hair.
        (TAIL, [HEAD]),
        ((np.array([0.0, 0.0, -0.2]), 0.03), [HEAD, (np.array([0, 0, -0.2]), 0.03)]),
        ((np.array([0.0, 0.0, -0.13]), 0.01), [HEAD, (np.array([0, 0, -0.13]), 0.01)]),
    ],
    ids=["not shown", "too far", "too small"],
)
def test_what_hangs_on_nothing_goes(tail, masks):
    hull = hull_with(*tail)
    found = bridged(hull, ROOTS, views_of(*masks))
    apart = np.linalg.norm(hull.grid.centres(hull.hair) - tail[0], axis=1) < tail[1]
    assert np.array_equal(found.hair[hull.hair], ~apart)
    assert found.hair.sum() == (~apart).sum()


def test_one_photograph_alone_is_not_believed():
    hull = hull_with(*TAIL)
    piece = hull.hair & (hull.grid.centres(hull.hair | True)[:, 2] < -0.11).reshape(
        hull.grid.shape
    )
    side = CAMERAS[2:3]
    shown, hidden = (views_of(*b, cameras=side) for b in ([HEAD, TAIL], [HEAD]))
    rest = hull.hair & ~piece
    assert shown_alone(hull.grid, piece, rest, shown + shown)
    assert not shown_alone(hull.grid, piece, rest, shown + hidden)
    # Where there is but one, it is.
    assert shown_alone(hull.grid, piece, rest, shown)


def test_hair_in_one_piece_stays_as_it_is():
    hull = hull_with(np.array([0.0, 0.0, -0.11]), 0.03)
    assert bridged(hull, ROOTS, views_of(HEAD)) is hull
    apart = hull_with(*TAIL)
    assert bridged(apart, np.full((1, 3), 0.12), views_of(HEAD, TAIL)) is apart


def test_large_pieces_stay_in_the_air_until_a_tie_is_found():
    hull = hull_with(*TAIL)
    assert np.array_equal(rooted_pieces(hull.hair, hull.head), hull.hair)
    share = 1.0 - rooted_pieces(hull.hair, hull.head, airborne=1.0).sum() / (
        hull.hair.sum()
    )
    assert 0.03 < share < 0.3
    assert np.array_equal(
        rooted_pieces(hull.hair, hull.head, airborne=0.9 * share), hull.hair
    )


@pytest.mark.slow
def test_the_tail_of_a_drawn_head_is_reached_through_a_tie_that_hides_it(tmp_path):
    head = make_head()
    scalp = make_scalp(head)
    tree = make_style("ponytail", 0, scalp)
    scene = Scene(6, (384, 512), strands=4000, points=64)
    write_capture(tree, head, tmp_path / "tied", scene)
    capture = load_capture(tmp_path / "tied")
    with np.load(tmp_path / "tied" / "truth.npz") as truth:
        strands = truth["points"].astype(float).reshape(-1, 64, 3)
    # The tie is where hairs come closest to each other.
    spread = np.linalg.norm(strands.std(axis=0), axis=1)
    at = int(spread[8:56].argmin()) + 8
    tie = strands[:, at].mean(axis=0)
    views = []
    for view in capture.views:
        pixel = project_points(tie[None], view.camera).pixel[0]
        y, x = np.indices(view.hair.shape) + 0.5
        near = np.hypot(x - pixel[0], y - pixel[1])
        scale = float(view.camera.K[0, 0]) / project_points(tie[None], view.camera)[1]
        views.append(view_of(view.camera, view.hair & (near > 0.02 * scale), view.name))
    depths = [mesh_depth(head, view.camera) for view in views]
    hull = carve(views, depths, head, 0.005)
    roots = np.asarray(points_on(scalp, sample_roots(scalp, 500, jax.random.key(0))))
    found = bridged(hull, roots, views)

    def reached(hull):
        """Return the share of the tails' tips in the piece that holds the roots."""
        pieces = pieces_of(hull.hair)
        sizes = np.bincount(pieces[pieces > 0])
        voxel = hull.grid.voxel(strands[:, -1])
        voxel = voxel[hull.grid.inside(voxel)]
        return (pieces[tuple(voxel.T)] == sizes.argmax()).mean()

    assert reached(hull) < 0.2
    assert reached(found) > 0.8
