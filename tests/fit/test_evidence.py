import jax
import numpy as np
import pytest
from ball_hair import camera_at, hull_where, view_of

from hairfit.capture.orientation import OrientationMap
from hairfit.fit import evidence
from hairfit.fit.evidence import SMOOTHING, Evidence, diffuse, gather

RADIUS = 0.06
# Four directions at right angles to cameras that look along -z, and down a slope.
ALONG = np.array([0.6, 0.8, 0.0])
FRONT, SIDE = np.array([0.0, 0.0, 0.6]), 0.6 * np.array([0.8, -0.6, 0.0])


@pytest.fixture(scope="module")
def hull():
    return hull_where(
        lambda p: np.linalg.norm(p, axis=1) < RADIUS,
        [-0.072] * 3,
        [0.072] * 3,
        0.006,
    )


def look(eye):
    """Return a view in which all is hair that runs along `ALONG`.

    The cameras' axes are at right angles to the hair: its angle is the same everywhere.
    """
    camera = camera_at(eye)
    hair = np.ones((camera.height, camera.width), bool)
    line = np.asarray(camera.cam_from_world)[:3, :3] @ ALONG
    assert abs(line[2]) < 1e-9
    angle = np.full(hair.shape, np.arctan2(line[1], line[0]) % np.pi)
    sure = np.ones(hair.shape)
    return view_of(camera, hair), OrientationMap(angle, sure, 0.07 * sure)


def gathered(hull, *eyes):
    views, maps = zip(*(look(eye) for eye in eyes), strict=True)
    free = [np.full(view.hair.shape, np.inf) for view in views]
    return gather(hull, views, maps, free)


def test_two_views_give_the_line_in_which_their_planes_meet(hull, monkeypatch):
    monkeypatch.setattr("hairfit.fit.evidence.SURFACE_WEIGHT", 0.0)
    found = gathered(hull, FRONT, SIDE)
    points = hull.grid.centres(hull.hair)
    weight = np.stack([gathered(hull, eye).weight for eye in (FRONT, SIDE)])
    assert (weight < 1e-2).all()  # a plane alone names no direction
    both = facing_both(points)
    assert np.allclose(np.abs(found.direction[both] @ ALONG), 1.0, atol=1e-9)
    assert (found.weight[both] > 0.1).all()
    behind = (points @ FRONT < -0.01) & (points @ SIDE < -0.01)
    assert (found.weight[behind] < 1e-3).all()


def facing_both(points):
    """Return which voxels at the surface both cameras see well."""
    out = points / np.linalg.norm(points, axis=1, keepdims=True)
    level = np.minimum(out @ FRONT, out @ SIDE) / 0.6
    found = (level > 0.55) & (np.linalg.norm(points, axis=1) > RADIUS - 0.006)
    assert found.sum() > 10
    return found


def test_the_surface_hardly_moves_what_two_views_agree_on(hull):
    found = gathered(hull, FRONT, SIDE)
    both = facing_both(hull.grid.centres(hull.hair))
    off = np.arccos(np.clip(np.abs(found.direction[both] @ ALONG), 0, 1))
    assert off.max() < np.radians(6)


def test_one_view_and_the_surface_give_the_tangent(hull):
    found = gathered(hull, FRONT)
    points = hull.grid.centres(hull.hair)
    eye_to = points - FRONT
    plane = np.cross(eye_to, ALONG)
    tangent = np.cross(plane, points)
    length = np.linalg.norm(tangent, axis=1)
    slanted = length > 0.3 * np.linalg.norm(plane, axis=1) * RADIUS
    seen = (found.weight > 0.05) & slanted & (np.linalg.norm(points, axis=1) > 0.05)
    assert seen.sum() > 50
    tangent = tangent[seen] / length[seen][:, None]
    cosine = np.abs((tangent * found.direction[seen]).sum(1))
    assert np.median(np.arccos(np.clip(cosine, 0, 1))) < np.radians(3)
    across = plane[seen] / np.linalg.norm(plane[seen], axis=1)[:, None]
    assert np.abs((across * found.direction[seen]).sum(1)).max() < np.radians(3)


def test_what_the_head_hides_says_nothing(hull):
    view, found = look(FRONT)
    before = np.zeros(view.hair.shape)
    assert (gather(hull, [view], [found], [before]).weight == 0).all()


def test_background_says_nothing(hull):
    (view, found), (side, _) = look(FRONT), look(SIDE)
    nothing = view_of(side.camera, np.zeros_like(side.hair))
    free = [np.full(view.hair.shape, np.inf)] * 2
    alone = gather(hull, [view], [found], free[:1])
    both = gather(hull, [view, nothing], [found, found], free)
    assert np.allclose(both.weight, alone.weight, atol=1e-12)


@pytest.fixture
def converged(monkeypatch):
    """Let the diffusion go on to its end."""
    monkeypatch.setattr(evidence, "TOLERANCE", 1e-6)
    jax.clear_caches()
    yield
    jax.clear_caches()


def box(shape, spacing=0.005):
    size = np.array(shape) * spacing
    return hull_where(lambda p: np.ones(len(p), bool), [0, 0, 0], size, spacing)


def at_angle(degrees, count):
    angle = np.radians(np.broadcast_to(degrees, count))
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


def test_one_direction_stays_that_direction():
    hull = box((7, 6, 8))
    count = hull.hair.sum()
    weight = np.random.default_rng(0).random(count)
    weight[: count // 2] = 0.0
    field = diffuse(hull, Evidence(at_angle(35.0, count), weight))
    assert np.allclose(np.abs(field.direction @ at_angle(35.0, 1)[0]), 1.0, atol=1e-5)
    assert (field.anisotropy > 0.95).all()


def plates(low, high, length=15):
    hull = box((6, 6, length))
    z = np.argwhere(hull.hair)[:, 2]
    ends = (z == 0) | (z == length - 1)
    direction = at_angle(np.where(z == 0, low, high), len(z))
    return diffuse(hull, Evidence(direction, ends.astype(float)))


def test_between_two_plates_hair_runs_as_on_the_plates():
    field = plates(120.0, 120.0)
    assert np.abs(field.direction @ at_angle(120.0, 1)[0]).min() > 1 - 1e-4


def test_between_two_directions_it_turns_evenly_from_one_to_the_other(converged):
    middle = plates(10.0, 50.0).direction[3, 3]
    angle = np.degrees(np.arctan2(middle[:, 1], middle[:, 0])) % 180.0
    assert (np.diff(angle) > 0).all()
    assert np.isclose(angle[7], 30.0, atol=0.5)
    assert np.allclose(angle + angle[::-1], 60.0, atol=1.0)


def test_across_the_end_of_the_half_circle_it_takes_the_short_way():
    # 170 and 10 degrees are 20 apart as lines: the middle is 0, not 90.
    middle = plates(170.0, 10.0).direction[3, 3, 7]
    assert abs(middle[0]) > 0.999


def test_the_sign_of_evidence_does_not_matter():
    hull = box((6, 5, 7))
    rng = np.random.default_rng(1)
    count = hull.hair.sum()
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    weight = rng.random(count)
    flipped = direction * rng.choice([-1.0, 1.0], (count, 1))
    one, other = (diffuse(hull, Evidence(d, weight)) for d in (direction, flipped))
    assert np.array_equal(one.direction, other.direction)
    assert np.array_equal(one.anisotropy, other.anisotropy)


def test_it_is_the_minimum_of_misfit_and_smoothness(converged):
    hull = hull_where(
        lambda p: np.linalg.norm(p - 0.02, axis=1) < 0.018, [0] * 3, [0.04] * 3, 0.005
    )
    rng = np.random.default_rng(2)
    index = np.argwhere(hull.hair)
    direction = rng.normal(size=(len(index), 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    weight = rng.random(len(index)) * (rng.random(len(index)) < 0.4)
    # Dense: every pair of voxels that share a face is a row of the Laplacian.
    apart = np.abs(index[:, None] - index[None]).sum(axis=2)
    near = (apart == 1).astype(float)
    matrix = np.diag(weight) + SMOOTHING * (np.diag(near.sum(1)) - near)
    target = (direction[:, :, None] * direction[:, None, :]).reshape(-1, 9)
    tensor = np.linalg.solve(matrix, weight[:, None] * target).reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(tensor)
    clear = values[:, 2] - values[:, 1] > 0.1
    assert clear.sum() > 30
    found = diffuse(hull, Evidence(direction, weight)).direction[hull.hair]
    cosine = np.abs((found * vectors[:, :, 2]).sum(axis=1))
    assert cosine[clear].min() > 1 - 1e-4


def test_a_guess_holds_where_photographs_are_silent_and_nowhere_else():
    hull = box((60, 3, 3))
    count = hull.hair.sum()
    weight = (np.argwhere(hull.hair)[:, 0] < 3).astype(float)
    guess = Evidence(at_angle(100.0, count), np.full(count, 0.015))
    field = diffuse(hull, Evidence(at_angle(10.0, count), weight), [guess])
    first, last = field.direction[1, 1, 1], field.direction[-2, 1, 1]
    assert abs(first @ at_angle(10.0, 1)[0]) > 0.999
    assert abs(last @ at_angle(100.0, 1)[0]) > 0.95
    alone = diffuse(hull, Evidence(at_angle(10.0, count), weight))
    assert abs(alone.direction[-2, 1, 1] @ at_angle(10.0, 1)[0]) > 0.999


def test_outside_the_hair_the_nearest_direction_holds():
    hull = hull_where(lambda p: p[:, 0] < 0.02, [0] * 3, [0.06, 0.03, 0.03], 0.005)
    count = hull.hair.sum()
    field = diffuse(hull, Evidence(at_angle(70.0, count), np.ones(count)))
    assert np.allclose(
        np.abs(field.direction[-1] @ at_angle(70.0, 1)[0]), 1.0, atol=1e-6
    )
