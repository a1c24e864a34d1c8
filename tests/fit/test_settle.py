import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.fit.gather import follow_maps, regress_maps
from hairfit.fit.root_scalp import scalp_points
from hairfit.fit.settle import drawn, led_to, matched, pieces, settled
from hairfit.fit.treeify import Rooted, on_scalp
from hairfit.model import Scalp

SIDE = 0.2
APART = np.array([[0.05, 0.1, 0.0], [0.15, 0.1, 0.0]])


def flat():
    """A level scalp of 20 cm."""
    side = np.linspace(0.0, SIDE, 13)
    x, z = np.meshgrid(side, side, indexing="ij")
    return Scalp(jnp.asarray(np.stack([x, np.zeros_like(x), -z], axis=-1)))


def rooted(scalp, uv, aside, length=3.0):
    """Strands that rise, or run aside, by default so long that they give way."""
    point, ground = on_scalp(scalp, jnp.asarray(uv))
    way = np.where(aside[:, None], [1.0, 0.3, 0.0], [0.0, 1.0, 0.0])
    way = way / np.linalg.norm(way, axis=1, keepdims=True)
    along = length * np.linspace(0.0, 1.0, 12)
    return Rooted(
        uv,
        np.asarray(point)[:, None] + along[:, None] * way[:, None],
        np.asarray(ground, np.float64),
    )


def even_places(count, seed):
    """Places all over a level scalp."""
    places = np.zeros((count, 3))
    places[:, :2] = np.random.default_rng(seed).uniform(0.0, SIDE, (count, 2))
    return places


@pytest.fixture
def mixed():
    """A patch of hair of which each fourth strand runs aside."""
    uv = np.random.default_rng(0).uniform(0.3, 0.7, (600, 2))
    aside = np.arange(600) % 4 == 0
    scalp = flat()
    return scalp, rooted(scalp, uv, aside), aside.astype(int)


def mixing(uv, label):
    """Return the share of strands that stand next to one of another cluster."""
    away = np.linalg.norm(uv[:, None] - uv[None], axis=2) + np.eye(len(uv))
    return np.mean(label[away.argmin(axis=1)] != label)


def test_clusters_come_apart_and_keep_their_strength(mixed):
    scalp, strands, label = mixed
    found = settled(scalp, strands, label, 500, 0)
    assert len(found.label) == 500
    assert mixing(strands.uv, label) > 0.3
    assert mixing(found.rooted.uv, found.label) < 0.15
    aside = found.rooted.knots[:, -1, 0] - found.rooted.knots[:, 0, 0] > 0.05
    assert np.array_equal(aside, found.label == 1)
    assert abs(aside.mean() - 0.25) < 0.03


def test_strands_start_on_the_scalp_at_their_roots_with_its_slopes(mixed):
    scalp, strands, label = mixed
    found = settled(scalp, strands, label, 500, 1).rooted
    assert np.abs(found.knots[:, 0] - scalp_points(scalp, found.uv)).max() < 1e-9
    assert len(np.unique(found.uv, axis=0)) == 500
    assert np.allclose(found.ground, [[SIDE, 0.0], [0.0, 0.0], [0.0, -SIDE]])


def test_the_same_seed_gives_the_same_roots(mixed):
    scalp, strands, label = mixed
    one, same, other = (
        settled(scalp, strands, label, 400, seed).rooted.uv for seed in (5, 5, 6)
    )
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)


def test_a_lone_cluster_gets_the_whole_scalp(mixed):
    scalp, strands, label = mixed
    found = settled(scalp, strands, np.zeros_like(label), 300, 0)
    assert (found.label == 0).all()
    assert np.ptp(found.rooted.uv, axis=0).min() > 0.9


def test_pieces_are_as_large_as_asked_and_around_their_middles():
    places = even_places(4000, 1)
    piece = pieces(places, APART, np.array([1, 3]), np.ones(2))
    assert abs(np.mean(piece == 1) - 0.75) < 0.03
    # A power diagram of two is cut by one line across the line between the middles.
    assert places[piece == 0, 0].max() < places[piece == 1, 0].min() + 1e-3


def test_pieces_of_short_hair_stay_where_it_grows():
    places = even_places(4000, 1)
    share = [
        np.mean(pieces(places, APART, np.array([1, 3]), np.full(2, sway)) == 1)
        for sway in (1e-3, 0.03, 0.06, 1.0)
    ]
    # Halfway between the middles at first, as large as the clusters are strong at last.
    assert abs(share[0] - 0.5) < 0.02
    assert np.min(np.diff(share)) > 0.02


def test_short_hair_keeps_its_roots_and_long_hair_its_strength(mixed):
    scalp, strands, label = mixed
    share, moved = [], []
    for length in (0.2, 0.6, 3.0):
        grown = rooted(scalp, strands.uv, label == 1, length)
        found = settled(scalp, grown, label, 500, 0)
        assert mixing(found.rooted.uv, found.label) < 0.15
        share.append(np.mean(found.label == 1))
        # Tips stay, and would go with their roots.
        there = rooted(scalp, found.rooted.uv, found.label == 1, length)
        away = (found.rooted.knots - there.knots)[:, -1]
        moved.append(np.linalg.norm(away, axis=1).mean())
    assert share[0] > share[1] > share[2] > 0.2
    assert abs(share[2] - 0.25) < 0.03
    assert moved[0] < moved[2]


def test_clusters_at_nearly_one_place_share_it():
    places = even_places(3000, 2)
    middles = np.full((3, 3), [0.1, 0.1, 0.0]) + 1e-3 * np.eye(3)
    piece = pieces(places, middles, np.full(3, 5), np.ones(3))
    share = np.bincount(piece, minlength=3) / 3000
    assert np.abs(share - 1 / 3).max() < 0.12


def test_members_are_drawn_once_where_there_are_enough_and_all_where_not():
    rng = np.random.default_rng(3)
    members = np.arange(10, 20)
    few, many = drawn(members, 6, rng), drawn(members, 25, rng)
    assert len(few) == len(set(few.tolist())) == 6
    assert len(many) == 25 and set(many.tolist()) == set(members.tolist())


def test_strands_are_matched_to_the_roots_that_they_came_from():
    rng = np.random.default_rng(4)
    uv = rng.uniform(size=(30, 2))
    slope = rng.normal(size=(33, 2))
    order = rng.permutation(30)
    lines = uv @ slope.T + 0.5
    assert np.array_equal(matched(uv, lines[order], slope), order)


def test_matching_makes_a_linear_map_fit_that_did_not(mixed):
    scalp, strands, _ = mixed
    turned = strands._replace(uv=np.random.default_rng(5).permutation(strands.uv))
    found = settled(scalp, turned, np.zeros(600, int), 600, 0).rooted

    def left(rooted):
        label = np.zeros(len(rooted.uv), int)
        rest = follow_maps(regress_maps(rooted, label), rooted.uv, label)
        return np.sqrt(np.mean((rest - rooted.knots)[:, -1] ** 2))

    assert left(found) < 0.75 * left(turned)


def test_strands_are_led_to_new_roots_and_keep_the_rest():
    strands = np.linspace(0.0, 0.3, 61)[:, None] * [0.0, 1.0, 0.0]
    strands = np.stack([strands, strands + [0.1, 0.0, 0.0]])
    roots = strands[:, 0] + [[0.02, 0.0, 0.0], [0.002, 0.0, 0.0]]
    led = led_to(strands, roots)
    assert np.allclose(led[:, 0], roots)
    # 20 mm over 10 cm, 2 mm over 3 cm; beyond that nothing moves.
    assert np.array_equal(led[0, 21:], strands[0, 21:])
    assert np.array_equal(led[1, 7:], strands[1, 7:])
    step = np.diff(led[0], axis=0)
    assert np.degrees(np.arctan(np.abs(step[:, 0]) / step[:, 1])).max() < 17.0
