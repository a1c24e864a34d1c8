import numpy as np
import pytest
from ball_hair import HEIGHT, WIDTH, camera_at, view_of

from hairfit.capture.orientation import SIGMA_BLIND, OrientationMap
from hairfit.fit.sightings import (
    SIGMA_OUTLINE,
    Told,
    angle_rows,
    angle_slopes,
    outline_distance,
    outline_rows,
    pieces_of,
    pixel_slopes,
    scatter,
    tell,
)
from hairfit.render.raster import cells, project_points

KNOTS = 4
SIGMA = 0.1


@pytest.fixture
def strands():
    """Two strands of a cluster each, bent, across the middle of the picture."""
    t = np.linspace(0.0, 1.0, KNOTS)
    first = np.stack([0.03 * t, 0.05 - 0.08 * t, 0.02 * t**2], axis=1)
    return np.stack([first, first * [-1.0, 1.0, 2.0] + [0.01, 0.0, 0.0]])


@pytest.fixture
def view():
    hair = np.zeros((HEIGHT, WIDTH), bool)
    hair[:, : WIDTH // 2 + 3] = True
    return view_of(camera_at([0.1, 0.05, 0.6]), hair)


def map_of(angle):
    angle = np.broadcast_to(np.mod(angle, np.pi), (HEIGHT, WIDTH)).astype(float)
    return OrientationMap(angle, np.ones_like(angle), np.full_like(angle, SIGMA))


def pieces(strands):
    return pieces_of(strands, np.arange(len(strands)), len(strands), KNOTS)


def rows_of(strands, view, found):
    some = pieces(strands)
    land = project_points(some.middle, view.camera)
    at = cells(land, view.camera.width, view.camera.height)
    return angle_rows(some, view, found, pixel_slopes(some.middle, view), at)


def picture_angle(strands, view):
    """Return the angle of each piece in the picture, at its middle."""
    some = pieces(strands)
    ahead = project_points(some.middle + 1e-6 * some.tangent, view.camera).pixel
    step = ahead - project_points(some.middle, view.camera).pixel
    return np.arctan2(step[:, 1], step[:, 0])


def test_pieces_lie_between_the_knots_that_move_them(strands):
    fine = np.stack([np.linspace(s[0], s[-1], 7) for s in strands])
    found = pieces_of(fine, np.array([1, 0]), 2, KNOTS)
    assert found.stretch.tolist() == [0, 0, 1, 1, 2, 2] * 2
    assert np.allclose(found.share, [0.25, 0.75] * 6)
    assert found.owner.tolist() == [1] * 6 + [0] * 6
    length = np.linalg.norm(fine[:, -1] - fine[:, 0], axis=1)
    assert np.allclose(found.speed, np.repeat(length / 3, 6))
    assert np.allclose(found.total(np.ones(12)), 2.0)


def test_the_slope_of_an_angle_is_what_moving_the_knots_does_to_it(strands, view):
    rows = rows_of(strands, view, map_of(0.3))
    moves = np.random.default_rng(0).normal(size=strands.shape)
    # Turns alone: what moves along a perspective picture without turning hardly counts.
    turns = moves - moves.mean(axis=1, keepdims=True)
    tiny = 1e-6
    change = picture_angle(strands + tiny * turns, view) - picture_angle(strands, view)
    both = np.concatenate([turns[:, :-1], turns[:, 1:]], axis=2).reshape(-1, 6)
    said = np.sum(rows.slope * both, axis=1)
    assert np.abs(change / tiny).min() > 1.0
    assert np.allclose(said, change / tiny, rtol=0.05, atol=2.0)


def test_a_photograph_tells_nothing_of_a_turn_towards_it(strands, view):
    some = pieces(strands)
    ray = some.middle - np.asarray(view.camera.centre)
    rows = rows_of(strands, view, map_of(0.3))
    turn = rows.slope[:, 3:]
    assert np.allclose(np.sum(turn * ray, axis=1), 0.0, atol=1e-6)
    assert np.allclose(np.sum(turn * some.tangent, axis=1), 0.0, atol=1e-6)


def test_a_strand_at_odds_with_the_photograph_is_known_less_well(strands, view):
    angle = picture_angle(strands, view)
    for off in (0.0, 0.4, -1.2):
        rows = rows_of(strands, view, map_of(angle[0] + off))
        assert np.isclose(rows.variance[0], SIGMA**2 + off**2, atol=1e-4)


def test_the_slope_of_an_orientation_map_is_that_of_its_angle():
    x, y = np.arange(WIDTH)[None] + 0.5, np.arange(HEIGHT)[:, None] + 0.5
    slope = angle_slopes(map_of(0.01 * x - 0.02 * y))
    inner = slope[20:-20, 20:-20]
    assert np.allclose(inner, [0.01, -0.02], rtol=0.01)


def test_where_the_photograph_turns_two_views_tell_where_hair_lies(strands, view):
    flat, bent = (
        rows_of(strands, view, map_of(angle))
        for angle in (0.3, 0.3 + 0.02 * np.arange(WIDTH)[None])
    )
    # All knots together: the hair moves and does not turn.
    assert np.allclose(flat.slope[:, :3] + flat.slope[:, 3:], 0.0, atol=1e-6)
    whole = bent.slope[:, :3] + bent.slope[:, 3:]
    shift = pixel_slopes(pieces(strands).middle, view)
    assert np.allclose(whole, -0.02 * shift[:, 0], rtol=0.05)


def test_the_distance_from_an_outline_is_in_metres():
    camera = camera_at([0.0, 0.0, 0.6], finer=8)
    hair = np.zeros((camera.height, camera.width), bool)
    hair[:, : camera.width // 2] = True  # up to the plane x = 0 of the world
    view = view_of(camera, hair)
    middle = np.array([[-0.02, 0.0, 0.0], [-0.0005, 0.0, 0.0], [0.02, 0.0, 0.0]])
    strands = middle[:, None] + np.array([[[0.0, 1e-3, 0.0], [0.0, -1e-3, 0.0]]])
    some = pieces_of(strands, np.arange(3), 3, 2)
    at = cells(project_points(some.middle, camera), camera.width, camera.height)
    shift, within = pixel_slopes(some.middle, view), outline_distance(view)
    rows, near = outline_rows(some, view, within, shift, np.full(3, 0.6), at)
    assert near.tolist() == [False, True, False]
    whole = rows.slope[:, :3] + rows.slope[:, 3:]
    # Moving out along x brings the hair as much nearer to the outline.
    assert np.allclose(whole[1], [-1.0, 0.0, 0.0], atol=0.02)
    assert np.isclose(rows.variance[0], SIGMA_OUTLINE**2)
    assert np.isclose(rows.variance[2], SIGMA_OUTLINE**2 + 0.02**2, rtol=0.1)


def test_only_what_is_seen_is_told_of(strands, view):
    hair = np.ones_like(view.hair)
    whole = view_of(view.camera, hair)
    some, found = pieces(strands), map_of(0.3)
    seen = np.zeros(len(some.middle), bool)
    seen[some.owner == 0] = True
    told = tell(some, whole, found, outline_distance(whole), seen)
    assert (np.linalg.norm(told.info[0], axis=(1, 2)) > 0).all()
    assert not told.info[1].any() and told.count.tolist() == [KNOTS - 1, 0]
    rows = rows_of(strands, whole, found)
    want = np.einsum("pi,pj->pij", rows.slope, rows.slope)
    want = (want / rows.variance[:, None, None])[: KNOTS - 1]
    assert np.allclose(told.info[0], want, rtol=1e-9)


def test_pixels_without_an_angle_tell_nothing(strands, view):
    whole = view_of(view.camera, np.ones_like(view.hair))
    blind = map_of(0.3)
    blind = OrientationMap(blind.angle, 0.0 * blind.angle, blind.sigma)
    some = pieces(strands)
    seen = np.ones(len(some.middle), bool)
    told = tell(some, whole, blind, outline_distance(whole), seen)
    assert not told.info.any() and not told.count.any()


def test_little_seen_clusters_scatter_as_all_do():
    none = np.zeros((3, 1, 6, 6))
    told = Told(none, np.array([8.0, 0.0, 1.0]), np.array([100.0, 0.0, 100.0]))
    mean = 9.0 / 200
    found = scatter(told, 50)
    want = [(8.0 + 50 * mean) / 150, mean, (1.0 + 50 * mean) / 150]
    assert np.allclose(found, want)
    nothing = Told(none, np.zeros(3), np.zeros(3))
    assert np.allclose(scatter(nothing, 50), SIGMA_BLIND**2)
