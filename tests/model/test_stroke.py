import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit.model import HairTree
from hairfit.model.edit import Grip
from hairfit.model.stroke import attract, comb, near_polyline, smooth

CIRCLES = [(0.4, 0.5, 0.2), (0.7, 0.5, 0.1), (0.4, 0.5, 0.1)]
PARENT = (-1, -1, 0)
KNOTS = 6


@pytest.fixture
def tree(flat, make_tree) -> HairTree:
    return make_tree(flat, CIRCLES, PARENT, knots=KNOTS, seed=2)


def steps(tree, index):
    return np.diff(np.asarray(tree.cylinder.skeleton[index]), axis=0)


def directions(tree, index):
    step = steps(tree, index)
    return step / np.linalg.norm(step, axis=1, keepdims=True)


def kept(before, after, index) -> bool:
    """Return whether the lengths from knot to knot and the root are as before."""
    long = [np.linalg.norm(steps(t, index), axis=1) for t in (before, after)]
    root = [t.cylinder.skeleton[index, 0] for t in (before, after)]
    return np.allclose(*long, atol=1e-9) and bool(jnp.array_equal(*root))


def test_combing_turns_hair_to_the_stroke_and_keeps_its_length(tree):
    middle = np.asarray(tree.cylinder.skeleton[0]).mean(axis=0)
    stroke = jnp.asarray(
        middle[None] + np.linspace(-0.2, 0.2, 5)[:, None] * np.eye(3)[:1]
    )
    combed = comb(tree, 0, stroke, 10.0, 1.0)
    assert np.allclose(directions(combed, 0), np.eye(3)[:1], atol=0.02)
    assert kept(tree, combed, 0)
    half = comb(tree, 0, stroke, 10.0, 0.5)
    turned = [directions(t, 0)[:, 0] for t in (tree, half, combed)]
    assert np.all(turned[0] < turned[1])
    assert np.all(turned[1] < turned[2])
    assert kept(tree, half, 0)


def test_combing_takes_hair_near_the_stroke_only(tree):
    tip = tree.cylinder.skeleton[0, -1]
    stroke = jnp.stack([tip - jnp.array([0.03, 0, 0]), tip + jnp.array([0.03, 0, 0])])
    combed = comb(tree, 0, stroke, 0.05)
    turned = np.linalg.norm(directions(combed, 0) - directions(tree, 0), axis=1)
    assert np.allclose(turned[:2], 0.0, atol=1e-12)
    assert turned[-1] > 0.3
    assert jnp.array_equal(combed.cylinder.skeleton[1], tree.cylinder.skeleton[1])
    assert not jnp.array_equal(combed.cylinder.skeleton[2], tree.cylinder.skeleton[2])


def test_smoothing_leaves_less_of_the_waves_and_keeps_lengths(tree):
    smoother = smooth(tree, 0)
    waves = [np.abs(np.diff(directions(t, 0), axis=0)).sum() for t in (tree, smoother)]
    assert waves[1] < 0.5 * waves[0]
    assert kept(tree, smoother, 0)
    line = np.linspace(0.0, 0.2, KNOTS)[:, None] * np.eye(3)[1]
    straight = eqx.tree_at(
        lambda t: t.cylinder.skeleton, tree, tree.cylinder.skeleton.at[0].set(line)
    )
    assert jnp.allclose(smooth(straight, 0).cylinder.skeleton[0], line, atol=1e-12)


def test_hair_is_drawn_to_a_curve_as_far_as_its_length_lets_it(tree):
    root = tree.cylinder.skeleton[0, 0]
    line = root[None] + np.linspace(0.0, 0.5, 6)[:, None] * np.array([[0.3, 1.0, 0.1]])
    drawn = attract(tree, 0, jnp.asarray(line), 10.0)
    near = jax.vmap(near_polyline, (None, 0))(
        jnp.asarray(line), drawn.cylinder.skeleton[0]
    )
    apart = jnp.linalg.norm(near.p - drawn.cylinder.skeleton[0], axis=1)
    before = jax.vmap(near_polyline, (None, 0))(
        jnp.asarray(line), tree.cylinder.skeleton[0]
    )
    far = jnp.linalg.norm(before.p - tree.cylinder.skeleton[0], axis=1)
    assert jnp.max(apart) < 0.2 * jnp.max(far)
    assert kept(tree, drawn, 0)
    out_of_reach = attract(tree, 0, jnp.asarray(line) + 1.0, 0.1)
    same = out_of_reach.cylinder.skeleton[0]
    assert jnp.allclose(same, tree.cylinder.skeleton[0], atol=1e-12)


def test_the_closest_point_of_a_polyline_is_known_by_hand():
    line = jnp.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    near = jax.jit(near_polyline)
    middle = near(line, jnp.array([0.5, -0.3, 0.0]))
    assert jnp.allclose(middle.p, jnp.array([0.5, 0.0, 0.0]))
    assert middle.direction[0] > 0.9
    end = near(line, jnp.array([1.2, 3.0, 0.0]))
    assert jnp.allclose(end.p, jnp.array([1.0, 1.0, 0.0]))
    assert jnp.allclose(end.direction, jnp.array([0.0, 1.0, 0.0]))
    corner = near(line, jnp.array([1.5, -0.5, 0.0]))
    assert jnp.allclose(corner.direction, jnp.array([1.0, 1.0, 0.0]) / np.sqrt(2))


def test_a_stroke_without_length_or_width_is_refused(tree):
    with pytest.raises(ValueError, match="stroke needs at least 2 points, got 1"):
        comb(tree, 0, jnp.zeros((1, 3)), 0.1)
    with pytest.raises(ValueError, match=r"radius of a stroke is positive, got 0.0 m"):
        attract(tree, 0, jnp.zeros((2, 3)), 0.0)


@pytest.mark.slow
def test_combing_has_gradients(tree):
    grip = Grip(knot=3, reach=3.0)

    def everything(skeleton, stroke):
        some = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton)
        some = comb(some, 1, stroke, 0.3, 0.6)
        some = attract(smooth(some, 1, rounds=1), 1, stroke, 0.3, 0.5, grip)
        return some.cylinder.skeleton[1], some.cylinder.scale[1]

    middle = tree.cylinder.skeleton[1].mean(axis=0)
    stroke = middle[None] + jnp.array([[-0.1, 0.013, 0.02], [0.1, 0.02, 0.03]])
    arguments = (tree.cylinder.skeleton, stroke)
    check_grads(jax.jit(everything), arguments, order=1, modes=["rev"], eps=1e-7)
