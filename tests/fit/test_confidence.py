import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import ball, dome, photograph, ring

from hairfit.fit.confidence import (
    ConfidenceConfig,
    Evidence,
    mean_of_leaves,
    solve,
    with_confidence,
)
from hairfit.fit.samples import Samples
from hairfit.model import HairTree, ScalpContour, grow_strands, leaves, plant

STAY = ConfidenceConfig().sigma_stay
LENGTH = 0.09


def planted(parent, centres, knots):
    """Clusters that stand on the dome's head, one under the other."""
    scalp, count = dome(), len(parent)
    contour = jax.vmap(ScalpContour)(
        jnp.asarray(centres), jnp.full(count, 0.1), jnp.zeros((count, 32))
    )
    cylinder = jax.vmap(lambda one: plant(scalp, one, LENGTH, knots))(contour)
    return HairTree(scalp, contour, cylinder, jnp.zeros(count), tuple(parent))


def evidence(tree, photographs=None, turn=1e9, place=0.0, scatter=0.0):
    shape = tree.count, tree.cylinder.skeleton.shape[1] - 1
    none = np.zeros((*shape, 6, 6))
    return Evidence(
        none if photographs is None else photographs,
        np.full(shape, turn),
        np.tile(place * np.eye(3), (*shape, 1, 1)),
        np.full(tree.count, scatter),
    )


def test_of_what_nothing_is_known_stays_by_the_cluster_above():
    tree = planted((-1, 0, 1), [[0.5, 0.5]] * 3, 2)
    found = solve(tree, evidence(tree), ConfidenceConfig())
    # A chain of three, each off the one above by sigma_stay; only the last is a leaf.
    assert np.allclose(found.sigma_position, np.sqrt(3.0) * STAY, rtol=1e-5)
    assert np.allclose(found.sigma_angle, np.sqrt(3.0) * STAY / LENGTH, rtol=1e-5)
    assert np.allclose(found.photographed, 0.0)


@pytest.mark.parametrize("known", [1e2, 1e4, 1e6])
def test_information_of_photographs_adds_to_what_is_held(known):
    tree = planted((-1,), [[0.5, 0.5]], 2)
    told = np.zeros((1, 1, 6, 6))
    told[0, 0, 3:, 3:] = known * np.eye(3)
    said = evidence(tree, told, scatter=0.01)
    found = solve(tree, said, ConfidenceConfig())
    variance = 1.0 / (1.0 / STAY**2 + known)
    assert np.isclose(found.sigma_position[0], np.sqrt(variance), rtol=1e-5)
    angle = np.sqrt(variance / LENGTH**2 + 0.01)
    assert np.isclose(found.sigma_angle[0], angle, rtol=1e-5)
    assert np.isclose(found.photographed[0], known * variance, rtol=1e-4)


def test_what_one_direction_shows_leaves_the_other_open():
    tree = planted((-1,), [[0.5, 0.5]], 2)
    told = np.zeros((1, 1, 6, 6))
    normal = np.asarray(tree.cylinder.normal[0], np.float64)
    told[0, 0, 3:, 3:] = 1e12 * np.outer(normal, normal)
    found = solve(tree, evidence(tree, told), ConfidenceConfig())
    assert np.isclose(found.sigma_position[0], STAY / np.sqrt(2.0), rtol=1e-4)
    assert np.isclose(found.photographed[0], 0.5, rtol=1e-4)


def test_the_direction_of_hair_around_and_the_masks_are_held_but_not_photographed():
    tree = planted((-1,), [[0.5, 0.5]], 2)
    turned = solve(tree, evidence(tree, turn=0.01**2), ConfidenceConfig())
    across = 1.0 / (1.0 / STAY**2 + 1.0 / (0.01 * LENGTH) ** 2)
    assert np.isclose(turned.sigma_position[0], np.sqrt(across), rtol=1e-5)
    # The middle of the stretch moves half as far as its end.
    placed = solve(tree, evidence(tree, place=1e6), ConfidenceConfig())
    inside = 1.0 / (1.0 / STAY**2 + 0.25 * 1e6)
    assert np.isclose(placed.sigma_position[0], np.sqrt(inside), rtol=1e-5)
    assert turned.photographed[0] == placed.photographed[0] == 0.0


def test_hair_that_is_all_parallel_has_a_finite_confidence():
    tree = planted((-1, 0), [[0.5, 0.5]] * 2, 4)
    found = solve(tree, evidence(tree, turn=0.0), ConfidenceConfig())
    assert 0.0 < found.sigma_angle[1] < 0.02 and 0.0 < found.sigma_position[1] < 0.002


def test_a_parent_that_is_photographed_vouches_for_its_children():
    tree = planted((-1, 0, -1, 2), [[0.3, 0.5], [0.3, 0.5], [0.7, 0.5], [0.7, 0.5]], 6)
    told = np.zeros((4, 5, 6, 6))
    told[0] = 1e8 * np.eye(6)
    found = solve(tree, evidence(tree, told), ConfidenceConfig())
    assert found.sigma_position[1] < 0.8 * found.sigma_position[3]
    assert found.photographed[1] == found.photographed[3] == 0.0


def test_a_cluster_with_children_holds_the_mean_of_its_leaves():
    tree = planted((-1, 0, 1, 1, 0), [[0.5, 0.5]] * 5, 2)
    assert leaves(tree).tolist() == [2, 3, 4]
    found = mean_of_leaves(tree, np.array([90.0, 90.0, 1.0, 3.0, 8.0]))
    assert np.allclose(found, [4.0, 2.0, 1.0, 3.0, 8.0])


# Four clusters around the head, each with one leaf: front, left, back and right.
AROUND = [[0.5, 0.15], [0.85, 0.5], [0.5, 0.85], [0.15, 0.5]]
STRANDS, KNOTS = 60, 8


@pytest.fixture(scope="module")
def tree():
    """Hair that hangs down outside of the ball."""
    stem = planted((-1,) * 4 + (0, 1, 2, 3), AROUND * 2, KNOTS)
    t = jnp.linspace(0.0, 1.0, KNOTS)[None, :, None]
    foot = stem.cylinder.skeleton[:, :1]
    out = foot * jnp.array([[[1.0, 0.0, 1.0]]])
    hanging = foot + 0.5 * t * out - 0.1 * t**2 * jnp.array([[[0.0, 1.0, 0.0]]])
    bent = eqx.tree_at(lambda x: x.cylinder.skeleton, stem, hanging)
    return jax.tree.map(lambda x: x.astype(jnp.float32), bent)


@pytest.fixture(scope="module")
def samples():
    rng = np.random.default_rng(0)
    owner = np.repeat(np.arange(4, 8), STRANDS)
    uv = np.asarray(AROUND)[owner - 4] + rng.uniform(-0.06, 0.06, (len(owner), 2))
    return Samples(jnp.asarray(uv, jnp.float32), jnp.asarray(owner))


def pictures(tree, samples, cameras):
    whole = jnp.ones(len(samples.owner), samples.uv.dtype)
    strands = grow_strands(tree, samples.uv, samples.owner, whole, 24)
    return photograph(np.asarray(strands), cameras, ball(), radius_px=2.0)


def confidence_of(tree, samples, taken):
    found = with_confidence(tree, samples, taken.views, taken.depths, taken.maps)
    assert found.confidence is not None
    return found.confidence


@pytest.fixture(scope="module")
def seen(tree, samples):
    """Photographs of the true tree from in front, and what they make of it."""
    cameras = [ring(12, finer=3)[k] for k in (11, 0, 1)]
    taken = pictures(tree, samples, cameras)
    return taken, confidence_of(tree, samples, taken)


def test_hair_that_cameras_see_is_surer_than_that_behind_the_head(tree, seen):
    _, found = seen
    towards = np.asarray(tree.cylinder.skeleton[4:, -1, 2])
    front, back = 4 + int(np.argmax(towards)), 4 + int(np.argmin(towards))
    assert found.photographed[front] > 0.08 and found.photographed[back] < 0.02
    assert found.sigma_position[front] < 0.7 * found.sigma_position[back]
    assert found.sigma_angle[front] < 0.7 * found.sigma_angle[back]


def test_more_photographs_make_surer(tree, samples, seen):
    _, few = seen
    many = confidence_of(tree, samples, pictures(tree, samples, ring(8, finer=3)))
    assert float(few.photographed[:4].mean()) < float(many.photographed[:4].mean())
    assert float(many.sigma_position.mean()) < 0.7 * float(few.sigma_position.mean())
    assert float(many.sigma_angle.mean()) < 0.8 * float(few.sigma_angle.mean())


def test_hair_that_photographs_contradict_is_less_sure(tree, samples, seen):
    taken, right = seen
    front = 4 + int(np.argmax(np.asarray(tree.cylinder.skeleton[4:, -1, 2])))
    turned = [
        dataclasses.replace(one, angle=np.mod(one.angle + 0.5, np.pi))
        for one in taken.maps
    ]
    wrong = confidence_of(tree, samples, taken._replace(maps=turned))
    # What photographs and strands differ by is among the errors to expect.
    assert wrong.sigma_angle[front] > 0.45 > right.sigma_angle[front]
    assert wrong.photographed[front] < right.photographed[front]


def test_confidence_of_nothing_is_refused(tree, samples):
    with pytest.raises(ValueError, match="one strand and one photograph"):
        with_confidence(tree, samples, [], [], [])
