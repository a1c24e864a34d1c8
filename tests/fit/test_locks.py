import dataclasses
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.capture import View
from hairfit.capture.orientation import OrientationMap
from hairfit.fit.curls import Curls
from hairfit.fit.locks import PHASES, best_paths, find_locks, with_locks
from hairfit.fit.shots import Shots, Trusted
from hairfit.model import even_maps, leaves, take
from hairfit.model.locks import Locks
from hairfit.model.strand import sample_hair
from hairfit.render import Camera, project_points
from hairfit.synthetic import make_head, make_scalp, make_style
from hairfit.synthetic.scene import looking_at

CURL = 0.006
POINTS = 100
WIDTH, HEIGHT, FOCAL = 300, 360, 700.0


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
    locks = Locks(jnp.asarray(phase, jnp.float32), jnp.asarray(hand, jnp.float32))
    maps = even_maps(4, 4, curl=CURL)
    return dataclasses.replace(tree, maps=maps, locks=locks)


def cameras(count=4):
    K = jnp.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0]])
    for angle in 2.0 * np.pi * np.arange(count) / count:
        eye = np.array([0.9 * np.sin(angle), 0.0, 0.9 * np.cos(angle)])
        pose = looking_at(eye, np.array([0.0, 0.0, 0.0]))
        yield Camera(K, jnp.asarray(pose), WIDTH, HEIGHT)


class Drawn(NamedTuple):
    found: OrientationMap
    owner: np.ndarray  # of the foremost hair in each pixel, -1 for none


def drawn(camera, strands, owner) -> Drawn:
    """Return the map of hair: in each pixel the angle of what is foremost."""
    pixel, depth = project_points(strands, camera)
    step = np.diff(pixel, axis=1)
    angle = np.mod(np.arctan2(step[..., 1], step[..., 0]), np.pi).ravel()
    middle = 0.5 * (pixel[:, 1:] + pixel[:, :-1]).reshape(-1, 2)
    order = np.argsort(-depth[:, 1:].ravel())
    shown = np.zeros((HEIGHT, WIDTH), np.float32)
    sure = np.zeros((HEIGHT, WIDTH), np.float32)
    whose, owner = np.full(sure.shape, -1), np.repeat(owner, POINTS - 1)
    column, row = np.floor(middle[order]).astype(int).T
    for y in (-1, 0, 1):
        for x in (-1, 0, 1):
            at = np.clip(row + y, 0, HEIGHT - 1), np.clip(column + x, 0, WIDTH - 1)
            shown[at], sure[at], whose[at] = angle[order], 1.0, owner[order]
    return Drawn(OrientationMap(shown, sure, 0.1 * np.ones_like(sure)), whose)


def photographs(tree):
    """Return views of hair, their maps, and how many pixels show each cluster."""
    hair = sample_hair(tree, 8000, POINTS, jax.random.key(7))
    strands, owner = np.asarray(hair.strands, np.float64), np.asarray(hair.owner)
    views, maps, shown = [], [], np.zeros(tree.count)
    for number, camera in enumerate(cameras()):
        found, whose = drawn(camera, strands, owner)
        image = np.zeros((*whose.shape, 3))
        views.append(View(f"{number:02d}", camera, image, whose >= 0))
        maps.append(found)
        shown += np.bincount(whose[whose >= 0], minlength=tree.count)
    return views, maps, shown


def test_locks_that_photographs_see_get_their_hand_and_phase_back(locked):
    views, maps, shown = photographs(locked)
    bare = dataclasses.replace(locked, locks=None)
    found = find_locks(bare, views, maps, POINTS, seed=1)
    true = locked.locks
    assert true is not None
    seen = np.flatnonzero(shown > np.median(shown[leaves(locked)]))
    right = np.asarray(found.hand == true.hand)[seen]
    assert right.mean() > 0.9
    off = np.asarray(found.phase - true.phase)[seen][right]
    assert np.cos(off).mean() > 0.4  # 0 at random, 0.6 here
    assert np.array_equal(found.phase, find_locks(bare, views, maps, POINTS, 1).phase)


def test_locks_that_no_photograph_sees_wind_at_random(locked):
    views, maps, _ = photographs(locked)
    blind = [dataclasses.replace(m, confidence=0.0 * m.confidence) for m in maps]
    found = find_locks(locked, views, blind, POINTS, seed=0)
    assert 0.4 < np.mean(np.asarray(found.hand) > 0.0) < 0.6
    phase = np.asarray(found.phase)
    assert np.array_equal(phase, np.tile(phase[:, :1], phase.shape[1]))
    assert abs(np.exp(1j * phase[:, 0]).mean()) < 0.15


@pytest.mark.parametrize("curls", [(0.0, True), (0.0035, False)])
def test_hair_whose_curls_are_not_seen_stays_as_it_is(locked, curls):
    radius, told = curls
    shots = Shots([], [], [], cast(Trusted, None), ())  # none is asked
    tree = dataclasses.replace(locked, locks=None)
    assert with_locks(tree, Curls(radius, [], told), shots, [], POINTS, 0) is tree


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
