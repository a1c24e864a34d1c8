import dataclasses
from typing import cast

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import photograph, ring

from hairfit.fit.curls import Curls
from hairfit.fit.locks import PHASES, best_paths, find_locks, with_locks
from hairfit.fit.shots import Shots, Trusted
from hairfit.model import even_maps, leaves, take
from hairfit.model.locks import PITCH, Locks
from hairfit.model.strand import sample_hair
from hairfit.synthetic import make_head, make_scalp, make_style

CURL = 0.006
POINTS = 100


@pytest.fixture(scope="module")
def locked():
    """Return hair of a few locks that hardly hide each other, each of its own hand."""
    tree = make_style("straight", 0, make_scalp(make_head()))
    lonely = leaves(tree)[::6]
    keep = np.isin(np.arange(tree.count), [*lonely, *np.asarray(tree.parent)[lonely]])
    tree = take(tree, keep)
    rng = np.random.default_rng(5)
    knots = tree.cylinder.skeleton.shape[1]
    drift = rng.uniform(-1.0, 1.0, (tree.count, 1)) * np.linspace(0.0, 1.0, knots)
    phase = rng.uniform(0.0, 2.0 * np.pi, (tree.count, 1)) + drift
    hand = rng.choice([-1.0, 1.0], tree.count)
    pitch = np.full(tree.count, PITCH)
    locks = Locks(*(jnp.asarray(one, jnp.float32) for one in (phase, hand, pitch)))
    maps = even_maps(4, 4, curl=CURL)
    return dataclasses.replace(tree, maps=maps, locks=locks)


def photographs(tree):
    hair = sample_hair(tree, 8000, POINTS, jax.random.key(7))
    return photograph(np.asarray(hair.strands), ring(4, finer=4), None)


def test_locks_that_photographs_see_get_their_hand_and_phase_back(locked):
    views, maps, _ = photographs(locked)
    bare = dataclasses.replace(locked, locks=None)
    found = find_locks(bare, views, maps, PITCH, POINTS, seed=1)
    true = locked.locks
    assert true is not None
    seen = leaves(locked)
    right = np.asarray(found.hand == true.hand)[seen]
    assert right.mean() > 0.9
    off = np.asarray(found.phase - true.phase)[seen][right]
    assert np.cos(off).mean() > 0.4  # 0 at random, 0.6 here
    again = find_locks(bare, views, maps, PITCH, POINTS, seed=1)
    assert np.array_equal(found.phase, again.phase)


def test_locks_that_no_photograph_sees_wind_at_random(locked):
    views, maps, _ = photographs(locked)
    blind = [dataclasses.replace(m, confidence=0.0 * m.confidence) for m in maps]
    found = find_locks(locked, views, blind, PITCH, POINTS, seed=0)
    assert 0.4 < np.mean(np.asarray(found.hand) > 0.0) < 0.6
    phase = np.asarray(found.phase)
    assert np.array_equal(phase, np.tile(phase[:, :1], phase.shape[1]))
    assert abs(np.exp(1j * phase[:, 0]).mean()) < 0.15


@pytest.mark.parametrize("curls", [(0.0, True), (0.0035, False)])
def test_hair_whose_curls_are_not_seen_stays_as_it_is(locked, curls):
    radius, told = curls
    shots = Shots([], [], [], cast(Trusted, None), ())  # none is asked
    tree = dataclasses.replace(locked, locks=None)
    assert (
        with_locks(tree, Curls(radius, PITCH * radius, [], told), shots, [], POINTS, 0)
        is tree
    )


def test_the_best_path_is_that_of_all_paths():
    rng = np.random.default_rng(0)
    told = rng.normal(size=(4, 3, 5))
    cost = 0.7
    every = np.stack(np.meshgrid(*[np.arange(4)] * 5, indexing="ij"), -1).reshape(-1, 5)
    step = np.abs(np.diff(every, axis=1))
    step = np.minimum(step, 4 - step)
    every, step = every[(step < 2).all(axis=1)], step[(step < 2).all(axis=1)]
    got = best_paths(told, cost)
    for cluster in range(3):
        sums = told[every, cluster, np.arange(5)].sum(axis=1) - cost * step.sum(axis=1)
        assert np.isclose(got.score[cluster], sums.max())
        assert np.array_equal(got.phase[cluster], every[sums.argmax()])


def test_a_phase_stays_where_steps_cost_more_than_they_bring():
    told = np.zeros((PHASES, 1, 6))
    told[3, 0, :3], told[4, 0, 3:] = 1.0, 1.1
    assert set(best_paths(told, 10.0).phase[0].tolist()) == {4}
    assert best_paths(told, 0.1).phase[0].tolist() == [3, 3, 3, 4, 4, 4]
