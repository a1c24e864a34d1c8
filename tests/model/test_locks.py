import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.model import graft, mirror, take
from hairfit.model.fur import LOOSE, curl_each, curl_strands, wind_strands
from hairfit.model.locks import PITCH, Locks, Winding, wind_along
from hairfit.model.reflect import mirror_cluster

RADIUS = 0.005


def locks_of(tree) -> Locks:
    assert tree.locks is not None
    return tree.locks


def upright(count, points=200, length=0.12):
    """Return strands along y."""
    y = jnp.linspace(0.0, length, points)
    line = jnp.stack([0.0 * y, y, 0.0 * y], axis=1)
    return jnp.tile(line, (count, 1, 1))


def turning(strands):
    """Return the angle about y of each point, unwrapped: it falls to the right."""
    return np.unwrap(np.arctan2(strands[..., 2], strands[..., 0]), axis=-1)


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_curls_wind_to_their_hand_with_the_drift_of_their_phase(hand):
    strands = upright(1)
    drift = jnp.linspace(0.0, 2.0, 200)[None]
    size, pitch = jnp.full(1, RADIUS), jnp.full(1, PITCH * RADIUS)
    wound = wind_strands(strands, size, pitch, drift, jnp.full(1, hand))
    after = np.asarray(strands[0, :, 1]) > PITCH * RADIUS
    far = np.hypot(wound[0, after, 0], wound[0, after, 2])
    assert np.allclose(far, RADIUS, rtol=1e-9)
    assert np.allclose(wound[..., 1], strands[..., 1], atol=1e-12)
    along = np.asarray(strands[0, :, 1])
    # A right-handed helix along y goes from z to x, against the angle from x to z.
    want = -(np.asarray(drift[0]) + hand * 2 * np.pi * along / (PITCH * RADIUS))
    got = turning(np.asarray(wound[0]))
    assert np.allclose(np.diff(got[after]), np.diff(want[after]), atol=1e-6)


def test_an_even_phase_to_the_right_is_a_plain_curl():
    strands = upright(3)
    size, pitch = jnp.full(3, RADIUS), jnp.full(3, PITCH * RADIUS)
    phase = jnp.array([0.0, 1.0, 2.0])
    plain = curl_strands(strands, size, pitch, phase)
    locked = wind_strands(
        strands, size, pitch, jnp.tile(phase[:, None], 200), jnp.ones(3)
    )
    assert jnp.allclose(locked, plain, atol=1e-12)


def test_hairs_of_a_lock_curl_nearly_together():
    count = 4000
    strands, size = upright(count, 40), jnp.full(count, RADIUS)
    apart = curl_each(strands, size, jax.random.key(0))
    even = Winding(jnp.zeros((count, 40)), jnp.ones(count), jnp.full(count, PITCH))
    together = curl_each(strands, size, jax.random.key(0), even)
    for hair, want in ((apart, 0.0), (together, np.exp(-(LOOSE**2) / 2.0))):
        angle = np.arctan2(hair[:, -1, 2], hair[:, -1, 0])
        assert abs(np.abs(np.exp(1j * angle).mean()) - want) < 0.03


@pytest.mark.parametrize("times", [3.0, 6.0, 8.0])
def test_locks_say_how_long_a_turn_is(times):
    count, points = 5, 400
    strands, size = upright(count, points), jnp.full(count, RADIUS)
    one = Winding(jnp.zeros((count, points)), jnp.ones(count), jnp.full(count, times))
    hair = np.asarray(curl_each(strands, size, jax.random.key(0), one) - strands)
    angle = np.unwrap(np.arctan2(hair[..., 2], hair[..., 0]), axis=1)[:, points // 2 :]
    along = np.asarray(strands)[:, points // 2 :, 1]
    turns = np.abs(angle[:, -1] - angle[:, 0]) / (2.0 * np.pi)
    assert np.allclose((along[:, -1] - along[:, 0]) / turns, times * RADIUS, rtol=1e-6)


def test_phases_go_evenly_from_knot_to_knot():
    phase = jnp.array([[0.0, 1.0, 4.0], [1.0, 1.0, 1.0]])
    locks = Locks(phase, jnp.array([1.0, -1.0]), jnp.array([4.0, 5.0]))
    owner, eta = jnp.array([0, 0, 1, -1]), jnp.array([1.0, 0.5, 0.7, 1.0])
    got, hand, pitch = wind_along(locks, owner, eta, 5)
    assert jnp.allclose(got[0], jnp.array([0.0, 0.5, 1.0, 2.5, 4.0]))
    assert jnp.allclose(got[1], jnp.array([0.0, 0.25, 0.5, 0.75, 1.0]))
    assert jnp.allclose(got[2], 1.0)
    assert jnp.allclose(got[3], got[0])
    assert jnp.array_equal(hand, jnp.array([1.0, 1.0, -1.0, 1.0]))
    assert jnp.array_equal(pitch, jnp.array([4.0, 4.0, 5.0, 4.0]))


@pytest.fixture
def locked(dome, make_tree):
    circles = [(0.3, 0.5, 0.1), (0.7, 0.5, 0.1), (0.3, 0.5, 0.05)]
    tree = make_tree(dome, circles, (-1, -1, 0), knots=5, seed=0)
    phase = jnp.arange(15.0).reshape(3, 5)
    locks = Locks(phase, jnp.array([1.0, -1.0, 1.0]), jnp.array([3.0, 4.0, 5.0]))
    return dataclasses.replace(tree, locks=locks)


def test_clusters_that_are_added_wind_as_what_they_belong_to(locked):
    contour, cylinder = jax.tree.map(
        lambda leaf: leaf[:2], (locked.contour, locked.cylinder)
    )
    grown = locks_of(graft(locked, contour, cylinder, jnp.zeros(2), (1, -1)))
    assert jnp.array_equal(grown.hand, jnp.array([1.0, -1.0, 1.0, -1.0, 1.0]))
    assert jnp.array_equal(grown.phase[3], locks_of(locked).phase[1])
    assert jnp.array_equal(grown.phase[4], jnp.zeros(5))
    assert jnp.array_equal(grown.pitch, jnp.array([3.0, 4.0, 5.0, 4.0, PITCH]))


def test_clusters_that_stay_keep_their_locks(locked):
    left = locks_of(take(locked, np.array([True, False, True])))
    assert jnp.array_equal(left.hand, jnp.ones(2))
    assert jnp.array_equal(left.phase, locks_of(locked).phase[jnp.array([0, 2])])


def test_in_a_mirror_curls_wind_the_other_way(locked):
    assert jnp.array_equal(locks_of(mirror(locked)).hand, -locks_of(locked).hand)
    both = locks_of(mirror_cluster(locked, 0))
    hands = jnp.array([1.0, -1.0, 1.0, -1.0, -1.0])
    assert jnp.array_equal(both.hand, hands)
    assert jnp.array_equal(both.phase[3:], locks_of(locked).phase[jnp.array([0, 2])])
