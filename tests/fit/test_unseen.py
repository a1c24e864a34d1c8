import numpy as np
import pytest
from ball_hair import FOCAL, HEIGHT, WIDTH, camera_at, view_of

from hairfit.fit.sightings import outline_distance, pieces_of
from hairfit.fit.unseen import (
    UNRELATED,
    find_room,
    half_square,
    place_variance,
    turn_variance,
    variogram,
)

SIDE = 0.06


def lines(count, way, seed=0):
    """Return short strands at random places in a cube, along `way` of their place."""
    rng = np.random.default_rng(seed)
    at = rng.uniform(0.0, SIDE, (count, 3))
    step = 0.001 * way(at, rng)
    strands = at[:, None] + np.array([-0.5, 0.5])[:, None] * step[:, None]
    return pieces_of(strands, np.zeros(count, int), 1, 2)


def upwards(at, rng):
    return np.tile([0.0, 1.0, 0.0], (len(at), 1))


def any_way(at, rng):
    way = rng.normal(size=at.shape)
    return way / np.linalg.norm(way, axis=1, keepdims=True)


def turning(at, rng):
    """20 radians a metre about z, along y."""
    angle = 20.0 * at[:, 1]
    return np.stack([np.sin(angle), np.cos(angle), 0.0 * angle], axis=1)


def test_lines_of_no_relation_differ_by_the_mean_over_all_directions():
    rng = np.random.default_rng(0)
    first, second = (any_way(np.zeros((100_000, 3)), rng) for _ in range(2))
    assert np.isclose(half_square(first, second).mean(), UNRELATED, rtol=0.01)
    assert np.allclose(half_square(first, -first), 0.0, atol=1e-12)


def test_parallel_hair_is_known_wherever_it_is():
    some = lines(2000, upwards)
    seen = some.middle[:, 0] < 0.01
    assert np.allclose(turn_variance(some, seen), 0.0, atol=1e-12)


def test_hair_that_runs_anyhow_is_not_known_from_the_hair_around():
    some = lines(3000, any_way)
    found = turn_variance(some, np.ones(3000, bool))
    # 23 neighbours each; what seen hair differs by does not grow with distance.
    assert np.isclose(found.mean(), UNRELATED, rtol=0.05)


def test_the_variogram_of_hair_that_turns_is_the_square_of_its_turn():
    some = lines(6000, turning)
    distance, variance = variogram(some)
    # Of a distance h in any direction, h^2 / 3 is along y, on average.
    want = 0.5 * (20.0 * distance) ** 2 / 3
    assert np.allclose(variance[1:5], want[1:5] - want[1], rtol=0.25, atol=2e-4)
    assert (np.diff(variance) >= 0).all()


def test_hair_far_from_what_is_seen_is_known_less():
    some = lines(6000, turning)
    seen = some.middle[:, 0] < 0.01
    found = turn_variance(some, seen)
    bins = [found[(some.middle[:, 0] // 0.01) == k].mean() for k in range(5)]
    assert (np.diff(bins) > 0).all() and bins[4] > 10 * bins[0]


def test_hair_that_nobody_sees_is_a_guess():
    some = lines(200, upwards)
    assert np.allclose(turn_variance(some, np.zeros(200, bool)), UNRELATED)


@pytest.mark.parametrize("deep", [0.0, 0.002, 0.006])
def test_the_place_is_as_sure_as_the_surface_above_it(deep):
    rng = np.random.default_rng(0)
    surface = np.abs(rng.normal(0.0, 0.004, 400_000))
    want = np.mean(np.maximum(surface - deep, 0.0) ** 2) + 0.0005**2
    found = place_variance(np.array([deep]), 0.004, 0.0005)[0]
    assert np.isclose(found, want, rtol=0.02)


def test_far_inside_hair_is_a_spacing_away_and_outside_as_far_as_it_is():
    found = place_variance(np.array([0.05, -0.03, np.inf]), 0.004, 0.0005)
    assert np.isclose(found[0], 0.0005**2)
    assert np.isclose(found[1], 0.004**2 + 0.03**2 + 0.0005**2)
    assert found[2] == np.inf


def test_the_depth_is_the_least_over_all_views_that_can_see():
    half = np.zeros((HEIGHT, WIDTH), bool)
    half[:, : WIDTH // 2] = True
    whole = np.zeros_like(half)
    whole[5:-5, 5:-5] = True
    front = view_of(camera_at([0.0, 0.0, 0.6]), half)
    back = view_of(camera_at([0.0, 0.0, -0.6]), whole)
    views = [front, back]
    within = [outline_distance(view) for view in views]
    middle = np.array([[-0.04, 0.0, 0.0], [0.02, 0.0, 0.0]])
    strands = middle[:, None] + np.array([[[0.0, -1e-3, 0.0], [0.0, 1e-3, 0.0]]])
    some = pieces_of(strands, np.zeros(2, int), 1, 2)
    free = [np.full(half.shape, np.inf)] * 2
    pixel = 0.6 / FOCAL
    found = find_room(some, views, free, within).deep
    assert np.allclose(found, [0.04, -0.02], atol=1.5 * pixel)
    # What the head hides from one view is judged by the other alone.
    blocked = [np.full(half.shape, 0.3), free[1]]
    side = (WIDTH / 2 - 5) * pixel
    found = find_room(some, views, blocked, within).deep
    assert np.allclose(found, [side - 0.04, side - 0.02], atol=1.5 * pixel)
    hidden = [np.full(half.shape, 0.3)] * 2
    room = find_room(some, views, hidden, within)
    assert np.isinf(room.deep).all() and not room.across.any()


def test_masks_bound_nothing_along_their_lines_of_sight():
    whole = np.ones((HEIGHT, WIDTH), bool)
    front = view_of(camera_at([0.0, 0.0, 0.6]), whole)
    side = view_of(camera_at([0.6, 0.0, 0.0]), whole)
    strand = np.array([[[0.0, -1e-3, 0.0], [0.0, 1e-3, 0.0]]])
    some = pieces_of(strand, np.zeros(1, int), 1, 2)

    def across(views):
        free = [np.full(whole.shape, np.inf)] * len(views)
        return find_room(
            some, views, free, [np.zeros(whole.shape)] * len(views)
        ).across[0]

    assert np.allclose(across([front]), np.diag([1.0, 1.0, 0.0]), atol=1e-9)
    assert np.allclose(across([front, side]), np.diag([0.5, 1.0, 0.5]), atol=1e-9)
