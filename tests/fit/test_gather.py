import numpy as np
import pytest

from hairfit.fit.gather import (
    COMPACT,
    Maps,
    Rooted,
    across,
    closest_maps,
    follow_maps,
    gather_strands,
    gather_upwards,
    regress_maps,
    robust_maps,
)

KNOTS = 8
GROUND = np.array([[0.2, 0.0], [0.0, 0.0], [0.0, 0.2]])  # a flat scalp of 20 cm


def fall(uv, direction, width=1.0):
    """Strands of 12 cm that run `direction` and spread to `width` times their roots."""
    t = np.linspace(0.0, 1.0, KNOTS)[None, :, None]
    root = uv @ GROUND.T
    middle = root.mean(axis=0)
    apart = (1.0 + (width - 1.0) * t) * (root - middle)[:, None]
    return middle + apart + 0.12 * t * np.asarray(direction)


def rooted(uv, knots):
    return Rooted(uv, knots, np.tile(GROUND, (len(uv), 1, 1)))


@pytest.fixture
def two():
    """Strands that rise, with strands among them that fall aside; which are which."""
    rng = np.random.default_rng(0)
    uv = 0.3 + 0.4 * rng.uniform(size=(400, 2))
    aside = rng.uniform(size=400) < 0.5
    up, side = fall(uv, [0.0, 1.0, 0.0]), fall(uv, [1.0, 0.0, 0.0])
    return rooted(uv, np.where(aside[:, None, None], side, up)), aside


def test_the_map_of_strands_that_spread_evenly_is_found():
    uv = np.random.default_rng(1).uniform(0.4, 0.6, (600, 2))
    strands = rooted(uv, fall(uv, [0.0, 1.0, 0.0], width=1.8))
    label = np.zeros(600, int)
    maps = regress_maps(strands, label)
    assert np.allclose(maps.slope[0, -1], 1.8 * GROUND, atol=1e-3)
    assert np.abs(follow_maps(maps, uv, label) - strands.knots).max() < 2e-5


def test_a_lone_strand_keeps_the_width_of_the_scalp():
    uv = np.array([[0.5, 0.5]])
    maps = regress_maps(rooted(uv, fall(uv, [0.0, 1.0, 0.0])), np.zeros(1, int))
    assert np.allclose(maps.slope[0], GROUND)


def test_slopes_keep_nothing_along_the_strands_but_at_the_scalp():
    rng = np.random.default_rng(2)
    curve, slope = rng.normal(size=(3, KNOTS, 3)), rng.normal(size=(3, KNOTS, 3, 2))
    kept = across(curve, slope)
    tangent = np.gradient(curve, axis=1)
    assert np.abs(np.einsum("gkx,gkxi->gki", tangent, kept)[:, 1:]).max() < 1e-12
    assert np.array_equal(kept[:, 0], slope[:, 0])


def test_strands_that_run_elsewhere_do_not_move_a_cluster():
    uv = np.random.default_rng(3).uniform(0.4, 0.6, (200, 2))
    knots = fall(uv, [0.0, 1.0, 0.0])
    straight = knots.mean(axis=0)
    knots[:20, 1:, 0] += 0.15
    label, strands = np.zeros(200, int), rooted(uv, knots)
    plain, robust = regress_maps(strands, label), robust_maps(strands, label)
    assert np.abs(plain.curve[0] - straight).max() > 0.01
    assert np.abs(robust.curve[0] - straight)[1:].max() < 0.002


def test_the_closest_map_is_that_of_a_slow_search():
    rng = np.random.default_rng(4)
    uv = rng.uniform(size=(70, 2))
    strands = rooted(uv, fall(uv, [0.0, 1.0, 0.0]) + 0.02 * rng.normal(size=(70, 8, 3)))
    middle = rng.uniform(size=(9, 2))
    slope = np.tile(GROUND, (9, KNOTS, 1, 1)) * rng.uniform(0.5, 2.0, (9, KNOTS, 1, 1))
    curve = fall(middle, [0.1, 0.9, 0.0]) + 0.02 * rng.normal(size=(9, KNOTS, 3))
    maps = Maps(middle, curve, slope)
    cost = np.empty((70, 9))
    for cluster in range(9):
        said = follow_maps(maps, uv, np.full(70, cluster))
        apart = ((said - strands.knots) ** 2).sum(axis=(1, 2)) / KNOTS
        place = ((strands.knots[:, 0] - curve[cluster, 0]) ** 2).sum(axis=1)
        cost[:, cluster] = apart + COMPACT * place
    assert np.array_equal(closest_maps(strands, maps), cost.argmin(axis=1))


def test_strands_that_run_elsewhere_from_among_others_are_a_cluster(two):
    strands, aside = two
    label = gather_strands(strands, 8, rounds=6, seed=0)
    share = np.array([aside[label == one].mean() for one in range(8)])
    assert np.minimum(share, 1.0 - share).max() < 0.05


def test_clusters_are_numbered_without_gaps(two):
    strands, _ = two
    label = gather_strands(strands, 30, rounds=4, seed=1)
    assert set(label) == set(range(label.max() + 1)) and label.max() < 30


def test_clusters_of_one_piece_of_scalp_get_one_parent():
    middle = np.array([[0.1, 0.1], [0.15, 0.1], [0.9, 0.9], [0.85, 0.9]])
    curve = fall(middle, [0.0, 1.0, 0.0])
    curve[0, -1] += [0.1, 0.0, 0.0]  # shapes differ less than places
    maps = Maps(middle, curve, np.tile(GROUND, (4, KNOTS, 1, 1)))
    above = gather_upwards(maps, 2, seed=0)
    assert above[0] == above[1] != above[2] == above[3]
