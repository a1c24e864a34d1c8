import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit import model
from hairfit.model import Wisps, find_owner, grow_strands, nearest_wisp

KNOTS = 6
CIRCLES = [(0.3, 0.5, 0.2), (0.7, 0.5, 0.2)]


@pytest.fixture
def tree(dome, make_tree):
    return make_tree(dome, CIRCLES, (-1, -1), knots=KNOTS)


def with_wisps(tree, uv, owner, offset):
    wisps = Wisps(jnp.asarray(uv), jnp.asarray(owner, jnp.int32), jnp.asarray(offset))
    return eqx.tree_at(lambda t: t.wisps, tree, wisps, is_leaf=lambda x: x is None)


def test_a_strand_follows_the_nearest_wisp_of_its_own_cluster():
    rng = np.random.default_rng(0)
    uv, owner = rng.uniform(size=(30, 2)), rng.integers(0, 3, 30)
    wisps = Wisps(jnp.asarray(uv), jnp.asarray(owner), jnp.zeros((30, KNOTS, 3)))
    roots, mine = rng.uniform(size=(200, 2)), rng.integers(-1, 4, 200)
    found = np.asarray(nearest_wisp(wisps, roots, mine))
    for root, cluster, wisp in zip(roots, mine, found, strict=True):
        same = np.flatnonzero(owner == cluster)
        if len(same) == 0:  # cluster 3 has none, and -1 is no cluster
            assert wisp == -1
        else:
            closest = np.argmin(np.linalg.norm(uv[same] - root, axis=1))
            assert wisp == same[closest]


def test_a_wisp_moves_strands_along_the_frame_turned_by_the_twist(tree):
    uv = jnp.array([[0.32, 0.55]])
    owner = find_owner(tree, uv)
    offset = np.zeros((1, KNOTS, 3))
    offset[0, :, 0], offset[0, :, 1], offset[0, :, 2] = 0.003, 0.01, 0.004
    bent = with_wisps(tree, uv, owner, offset)
    whole = jnp.ones(1)
    move = grow_strands(bent, uv, owner, whole, KNOTS) - grow_strands(
        tree, uv, owner, whole, KNOTS
    )
    one = model.cluster(tree.cylinder, 0)
    frames = model.cylinder_frames(one)
    for knot in range(1, KNOTS):  # the root stays on the scalp
        turn = complex(np.cos(one.twist[knot]), np.sin(one.twist[knot]))
        across = (0.01 + 0.004j) * turn
        want = (
            0.003 * frames.tangent[knot]
            + across.real * frames.normal[knot]
            + across.imag * frames.binormal[knot]
        )
        assert jnp.allclose(move[0, knot], want, atol=1e-12)
    assert jnp.all(move[0, 0] == 0.0)


def test_no_wisps_change_nothing(tree):
    uv = jnp.array([[0.32, 0.55], [0.72, 0.5]])
    owner = find_owner(tree, uv)
    empty = with_wisps(tree, np.zeros((0, 2)), np.zeros(0), np.zeros((0, KNOTS, 3)))
    other = with_wisps(tree, [[0.7, 0.5]], [1], np.ones((1, KNOTS, 3)))
    plain = grow_strands(tree, uv, owner, jnp.ones(2), 9)
    none = grow_strands(empty, uv, owner, jnp.ones(2), 9)
    assert jnp.allclose(none, plain, rtol=0, atol=1e-14)
    first = grow_strands(other, uv, owner, jnp.ones(2), 9)[0]
    assert jnp.allclose(first, plain[0], rtol=0, atol=1e-14)


def test_wisps_go_with_their_clusters(dome, make_tree):
    tree = make_tree(dome, [*CIRCLES, (0.3, 0.5, 0.15)], (-1, -1, 0), knots=KNOTS)
    uv = np.array([[0.7, 0.5], [0.3, 0.5]])
    tree = with_wisps(tree, uv, [1, 2], np.zeros((2, KNOTS, 3)))
    left = model.drop(tree, 0)
    assert left.parent == (-1,)
    assert left.wisps is not None
    assert left.wisps.owner.tolist() == [0]
    assert left.wisps.uv.tolist() == [[0.7, 0.5]]
    # Without its child, cluster 0 owns the wisp of the child once it is rehoused.
    pruned = model.drop_descendants(tree, 0)
    assert pruned.wisps is not None
    assert pruned.wisps.owner.tolist() == [1]
    moved = with_wisps(pruned, uv, [1, 1], np.zeros((2, KNOTS, 3)))
    housed = model.rehouse_wisps(moved).wisps
    assert housed is not None
    assert housed.owner.tolist() == [1, 0]


@pytest.mark.parametrize("edited", [[0], [1], [0, 1], []])
def test_growing_edited_clusters_alone_is_growing_all(tree, edited):
    rng = np.random.default_rng(1)
    uv = jnp.asarray(rng.uniform(0.1, 0.9, size=(300, 2)))
    owner, eta = find_owner(tree, uv), jnp.asarray(rng.uniform(0.5, 1.0, 300))
    before = grow_strands(tree, uv, owner, eta, 9)
    bend = jnp.zeros(tree.count).at[jnp.asarray(edited, int)].set(0.1)
    skeleton = tree.cylinder.skeleton + bend[:, None, None]
    after = eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton)
    want = grow_strands(after, uv, owner, eta, 9)
    found = model.regrow_strands(after, before, uv, owner, eta, edited)
    assert jnp.allclose(found, want, atol=1e-12)


def test_grafted_clusters_stand_behind_the_others(tree):
    last = slice(1, None)
    contour, cylinder = jax.tree.map(lambda x: x[last], (tree.contour, tree.cylinder))
    grown = model.graft(tree, contour, cylinder, jnp.full(1, 0.3), (0,))
    assert grown.parent == (-1, -1, 0)
    assert jnp.all(grown.cylinder.skeleton[2] == tree.cylinder.skeleton[1])
    assert grown.length_variation.tolist() == [0.0, 0.0, 0.3]


def test_clusters_of_other_knots_are_not_grafted(tree, dome, make_tree):
    other = make_tree(dome, CIRCLES, (-1, -1), knots=7)
    with pytest.raises(ValueError, match="clusters of 7 knots cannot be grafted"):
        model.graft(tree, other.contour, other.cylinder, jnp.zeros(2), (-1, -1))
