import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit.model import arc_length, cluster, cylinder_knots
from hairfit.model.edit import Grip
from hairfit.model.reshape import Curl, bend, curl, move, rotate, scale, twist

CIRCLES = [(0.4, 0.5, 0.2), (0.7, 0.5, 0.1), (0.4, 0.5, 0.1)]
PARENT = (-1, -1, 0)
KNOTS = 6
UP = np.array([0.0, 1.0, 0.0])
around = jax.jit(jax.vmap(cylinder_knots, (None, None, 0), 1))


@pytest.fixture
def tree(flat, make_tree):
    return make_tree(flat, CIRCLES, PARENT, knots=KNOTS, seed=2)


@pytest.fixture
def straight(flat, make_tree):
    """Return a tree of straight hair of 20 cm on the plane y = 0, 2 amid 0."""
    made = make_tree(flat, CIRCLES, PARENT, knots=KNOTS, seed=2)
    along = jnp.linspace(0.0, 0.2, KNOTS)
    root = jnp.array([[0.5, 0.0, 0.4], [0.5, 0.0, 0.7], [0.5, 0.0, 0.4]])[:, None]
    up = root + along[None, :, None] * jnp.asarray(UP)[None, None]
    return eqx.tree_at(
        lambda t: (t.cylinder.skeleton, t.cylinder.twist),
        made,
        (up, jnp.zeros_like(made.cylinder.twist)),
    )


def lengths(tree, index):
    steps = np.diff(np.asarray(tree.cylinder.skeleton[index]), axis=0)
    return np.linalg.norm(steps, axis=1)


def others_stay(before, after, index) -> bool:
    pairs = zip(
        jax.tree.leaves(before.cylinder), jax.tree.leaves(after.cylinder), strict=True
    )
    return all(bool(jnp.array_equal(a[index], b[index])) for a, b in pairs)


def test_a_picked_control_point_moves_with_its_surroundings(tree):
    step = jnp.array([0.02, 0.0, -0.01])
    moved = move(tree, 0, step, Grip(knot=3, reach=2.0))
    by = moved.cylinder.skeleton[0] - tree.cylinder.skeleton[0]
    share = jnp.array([0.0, 0.0, 0.5, 1.0, 0.5, 0.0])
    assert jnp.allclose(by, share[:, None] * step[None], atol=1e-12)
    assert others_stay(tree, moved, 1)
    child = moved.cylinder.skeleton[2] - tree.cylinder.skeleton[2]
    assert jnp.linalg.norm(child[3] - step) < 0.5 * jnp.linalg.norm(step)


def test_moving_the_whole_cluster_leaves_its_root(straight):
    moved = move(straight, 0, jnp.array([0.05, 0.0, 0.0]))
    by = moved.cylinder.skeleton - straight.cylinder.skeleton
    assert jnp.allclose(by[0, 1:], jnp.array([[0.05, 0.0, 0.0]]), atol=1e-12)
    assert jnp.array_equal(by[0, 0], jnp.zeros(3))


def test_a_cluster_turned_about_its_root_keeps_its_form(tree):
    angle, axis = 0.8, np.array([0.0, 0.0, 2.0])
    turned = rotate(tree, 0, axis, angle)
    cos, sin = np.cos(angle), np.sin(angle)
    turn = jnp.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    theta = jnp.linspace(0.0, 6.0, 5)
    old = around(cluster(tree.cylinder, 0), 1.0, theta)
    root = tree.cylinder.skeleton[0, 0][None, None]
    got = around(cluster(turned.cylinder, 0), 1.0, theta)
    assert jnp.allclose(got, root + (old - root) @ turn.T, atol=1e-9)


def test_turning_a_straight_cluster_about_itself_twists_it(straight):
    turned = rotate(straight, 0, UP, 2.0, Grip(knot=3, reach=2.0))
    assert jnp.allclose(turned.cylinder.skeleton[0], straight.cylinder.skeleton[0])
    share = np.array([0.0, 0.0, 0.5, 1.0, 0.5, 0.0])
    assert jnp.allclose(turned.cylinder.twist[0], 2.0 * share, atol=1e-9)


def test_scale_multiplies_both_axes_and_the_children_follow(straight):
    scaled = scale(straight, 0, (2.0, 0.5))
    for name, factor in (("scale", [2.0, 0.5]), ("shear", 2.0)):
        got, old = (getattr(t.cylinder, name)[0] for t in (scaled, straight))
        want = old * (jnp.asarray(factor)[None] if name == "scale" else factor)
        assert jnp.allclose(got, want)
    width = jnp.linalg.det(jnp.asarray([[2.0, 0.0], [0.0, 0.5]]))
    assert jnp.allclose(width, 1.0)
    theta = jnp.linspace(0.0, 6.0, 5)
    spread = [
        around(cluster(t.cylinder, 2), 1.0, theta)[3] - t.cylinder.skeleton[0, 3][None]
        for t in (straight, scaled)
    ]
    normal = straight.cylinder.normal[0]
    across = jnp.stack([normal, jnp.cross(jnp.asarray(UP), normal)])
    flat = [s @ across.T for s in spread]
    assert jnp.allclose(flat[1], flat[0] * jnp.array([[2.0, 0.5]]), atol=1e-9)


def test_twist_grows_from_root_to_tip_or_around_a_control_point(straight):
    whole = twist(straight, 0, 5.0)
    assert jnp.allclose(whole.cylinder.twist[0], jnp.linspace(0.0, 5.0, KNOTS))
    picked = twist(straight, 0, 5.0, Grip(knot=3, reach=1.0))
    assert jnp.allclose(picked.cylinder.twist[0], jnp.array([0, 0, 0, 5.0, 0, 0]))
    # The cluster below, which stands in the middle, is twisted with it.
    assert jnp.allclose(whole.cylinder.twist[2], jnp.linspace(0.0, 5.0, KNOTS))


def test_a_bend_is_an_arc_and_keeps_lengths(straight):
    bent = bend(straight, 0, np.array([0.0, 0.0, 1.0]), 1.5)
    assert np.allclose(lengths(bent, 0), lengths(straight, 0), atol=1e-12)
    steps = np.diff(np.asarray(bent.cylinder.skeleton[0]), axis=0)
    angle = np.arctan2(-steps[:, 0], steps[:, 1])
    assert np.allclose(angle, 1.5 * (np.arange(5) + 0.5) / 5, atol=1e-9)
    assert others_stay(straight, bent, 1)
    # A cluster in the middle of it follows to the same arc.
    assert jnp.allclose(bent.cylinder.skeleton[2], bent.cylinder.skeleton[0], atol=1e-3)


def test_a_bend_of_a_span_turns_what_is_behind_as_a_whole(straight):
    bent = bend(straight, 0, np.array([0.0, 0.0, 1.0]), 1.0, (0.4, 0.6))
    steps = np.diff(np.asarray(bent.cylinder.skeleton[0]), axis=0)
    angle = np.arctan2(-steps[:, 0], steps[:, 1])
    assert np.allclose(angle, [0, 0, 0.5, 1, 1], atol=1e-9)
    with pytest.raises(ValueError, match=r"bend ends behind its begin, got .*0\.6, 0"):
        bend(straight, 0, UP, 1.0, (0.6, 0.4))


def test_curls_are_a_helix_about_the_skeleton(straight):
    how = Curl(radius=0.01, pitch=0.2, ramp=0.2, phase=0.3)
    curly = curl(straight, 0, how)
    rest = np.asarray(curly.cylinder.skeleton[0] - straight.cylinder.skeleton[0])
    assert np.allclose(np.linalg.norm(rest, axis=1), [0] + 5 * [0.01], atol=1e-12)
    assert np.allclose(rest @ UP, 0.0, atol=1e-12)
    turn = np.cross(rest[1:-1], rest[2:]) @ UP / 0.01**2
    assert np.allclose(np.arcsin(turn), 2 * np.pi * 0.04 / 0.2, atol=1e-6)
    flat = np.asarray(curl(straight, 0, Curl(0.01, 0.16, depth=0.0)).cylinder.skeleton)
    waves = flat[0] - np.asarray(straight.cylinder.skeleton[0])
    assert np.linalg.matrix_rank(waves, tol=1e-9) == 1


def test_curls_need_knots(straight):
    with pytest.raises(ValueError, match="need 41 knots, it has 6; resample the tree"):
        curl(straight, 0, Curl(radius=0.01, pitch=0.02))


@pytest.mark.slow
def test_operations_have_gradients(tree):
    grip = Grip(knot=3, reach=2.0)

    def everything(skeleton, angle, step):
        some = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton)
        some = move(some, 1, step, grip)
        some = rotate(some, 1, step, angle, grip)
        some = bend(some, 1, step, angle)
        some = twist(scale(some, 1, (1.2, 0.9), grip), 1, angle)
        some = curl(some, 1, Curl(0.01, 0.3))
        return some.cylinder.skeleton[1], some.cylinder.scale[1]

    step = jnp.array([0.01, 0.02, 0.005])
    arguments = (tree.cylinder.skeleton, jnp.array(0.4), step)
    check_grads(jax.jit(everything), arguments, order=1, modes=["rev"], eps=1e-7)


def test_a_longer_curl_makes_a_longer_skeleton(straight):
    curly = curl(straight, 0, Curl(radius=0.02, pitch=0.16))
    length = [arc_length(t.cylinder.skeleton[0])[-1] for t in (straight, curly)]
    assert length[1] > 1.1 * length[0]
