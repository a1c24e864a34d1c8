import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ball_hair import RADIUS, ball, dome, hull_where, photograph, ring
from jax.test_util import check_grads

from hairfit.fit.evidence import Field
from hairfit.fit.refine import (
    FULL_PACE,
    LEAST_PACE,
    STEADY,
    Found,
    Guide,
    Moves,
    Photographs,
    RefineConfig,
    ancestors,
    carry,
    descend,
    moved,
    paces,
    problem_of,
    refine,
    stretched,
    turn_of,
    turns,
)
from hairfit.fit.residuals import find_pulls, photo_maps, seen_segments
from hairfit.fit.samples import Samples, grow_placed
from hairfit.fit.volume import find_gaps, hair_volume
from hairfit.model import (
    HairTree,
    ScalpContour,
    cluster,
    find_owner,
    grow_strands,
    plant,
    sample_roots,
)
from hairfit.model.cylinder import cylinder_frames

KNOTS, POINTS, STRANDS = 8, 12, 800
CENTRES = [[0.35, 0.4], [0.65, 0.6], [0.3, 0.4], [0.42, 0.4], [0.6, 0.6], [0.7, 0.6]]
PARENT = (-1, -1, 0, 0, 1, 1)


@pytest.fixture(scope="module")
def tree():
    """Two root clusters of two leaves each; they rise and bow outwards."""
    scalp = dome()
    count = len(PARENT)
    contour = jax.vmap(ScalpContour)(
        jnp.array(CENTRES),
        jnp.array([0.25, 0.25, 0.15, 0.15, 0.15, 0.15]),
        jnp.zeros((count, 32)),
    )
    planted = jax.vmap(lambda c: plant(scalp, c, 0.1, KNOTS))(contour)
    t = jnp.linspace(0.0, 1.0, KNOTS)[None, :, None]
    outward = planted.skeleton[:, :1] * jnp.array([[[1.0, 0.0, 1.0]]])
    bow = 0.6 * t**2 * outward - 0.04 * t**2 * jnp.array([[[0.0, 1.0, 0.0]]])
    cylinder = eqx.tree_at(lambda c: c.skeleton, planted, planted.skeleton + bow)
    return HairTree(scalp, contour, cylinder, jnp.zeros(count), PARENT)


def single(tree):
    return jax.tree.map(lambda x: x.astype(jnp.float32), tree)


def rotation(axis, angle):
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def guide(cylinder):
    return Guide(cylinder.skeleton, cylinder_frames(cylinder), cylinder.twist)


def test_a_child_of_a_parent_that_did_not_change_does_not_either(tree):
    parent, child = cluster(tree.cylinder, 0), cluster(tree.cylinder, 2)
    found = carry(guide(parent), guide(parent), child.skeleton)
    assert np.allclose(found, child.skeleton, atol=1e-15)


def test_a_child_goes_with_a_parent_that_moves_as_a_rigid_body(tree):
    parent, child = cluster(tree.cylinder, 0), cluster(tree.cylinder, 3)
    turn = jnp.asarray(rotation([1.0, 2.0, -0.5], 1.1))
    shift = jnp.array([0.02, -0.03, 0.05])
    after = eqx.tree_at(
        lambda c: (c.skeleton, c.normal),
        parent,
        (parent.skeleton @ turn.T + shift[None], turn @ parent.normal),
    )
    found = carry(guide(parent), guide(after), child.skeleton)
    assert np.allclose(found, child.skeleton @ turn.T + shift[None], atol=1e-12)


def test_a_child_turns_with_its_parents_twist(tree):
    parent, child = cluster(tree.cylinder, 0), cluster(tree.cylinder, 2)
    angle = 0.7
    after = eqx.tree_at(lambda c: c.twist, parent, parent.twist + angle)
    found = carry(guide(parent), guide(after), child.skeleton)
    for k in range(KNOTS):
        before_k = np.asarray(child.skeleton[k] - parent.skeleton[k])
        after_k = np.asarray(found[k] - parent.skeleton[k])
        assert np.isclose(np.linalg.norm(before_k), np.linalg.norm(after_k))
    # At the root the tangent is the chord: the turn is about it.
    tangent = parent.skeleton[1] - parent.skeleton[0]
    first = np.asarray(child.skeleton[0] - parent.skeleton[0])
    expected = rotation(tangent, angle) @ first
    assert np.allclose(found[0] - parent.skeleton[0], expected, atol=1e-12)


def test_the_gradient_through_a_parent_is_right(tree):
    parent, child = cluster(tree.cylinder, 0), cluster(tree.cylinder, 2)

    def carried(skeleton, twist):
        after = eqx.tree_at(lambda c: (c.skeleton, c.twist), parent, (skeleton, twist))
        return carry(guide(parent), guide(after), child.skeleton)

    arguments = parent.skeleton, parent.twist
    check_grads(
        jax.jit(carried), arguments, order=1, modes=["rev"], eps=1e-7, rtol=1e-4
    )


def test_ancestors_are_found_on_every_level():
    parent = (-1, -1, 0, 1, 2, 3, 2, 0)
    assert ancestors(parent, 0) == [0, 1, 0, 1, 0, 1, 0, 0]
    assert ancestors(parent, 1) == [0, 1, 2, 3, 2, 3, 2, 7]
    assert ancestors(parent, 2) == list(range(8))


def no_moves(tree):
    c = tree.cylinder
    return Moves(*(jnp.zeros_like(x) for x in (c.skeleton, c.scale, c.twist, c.shear)))


@pytest.fixture(scope="module")
def scene(tree):
    """Photographs of the tree's hair, and what `refine` takes besides a tree."""
    uv = sample_roots(tree.scalp, 4 * STRANDS, jax.random.key(2))
    owner = find_owner(tree, uv)
    index = np.flatnonzero(np.asarray(owner) >= 0)
    thick = grow_strands(tree, uv[index], owner[index], jnp.ones(len(index)), 24)
    taken = photograph(np.asarray(thick), ring(5, finer=3), ball(), radius_px=1.5)
    held = np.resize(index, STRANDS)
    samples = Samples(uv[held].astype(jnp.float32), owner[held])
    hull = hull_where(
        lambda p: np.linalg.norm(p, axis=1) > RADIUS,
        [-0.2] * 3,
        [0.2] * 3,
        0.01,
        head=lambda p: np.linalg.norm(p, axis=1) - RADIUS,
    )
    maps = photo_maps(taken.views, taken.maps, taken.depths)
    # Nothing is known of the direction within.
    nowhere = np.zeros(hull.grid.shape)
    field = Field(np.zeros((*hull.grid.shape, 3)), nowhere)
    return taken, samples, maps, hair_volume(hull, field)


def strands_of(tree, samples):
    ones = jnp.ones(STRANDS, samples.uv.dtype)
    return np.asarray(grow_strands(tree, samples.uv, samples.owner, ones, POINTS))


def test_moves_of_nothing_change_nothing(tree, scene):
    _, samples, maps, head = scene
    tree = single(tree)
    for level in range(2):
        problem = problem_of(tree, samples, maps, head)
        found = moved(problem, no_moves(tree), turn_of(tree, level))
        for mine, given in zip(
            jax.tree.leaves(found), jax.tree.leaves(tree.cylinder), strict=True
        ):
            assert np.allclose(mine, given, atol=1e-7)


def test_moves_of_one_level_move_it_and_what_hangs_on_it(tree, scene):
    _, samples, maps, head = scene
    tree = single(tree)
    problem = problem_of(tree, samples, maps, head)
    shift = jnp.array([0.004, 0.0, -0.002], jnp.float32)
    moves = no_moves(tree)
    moves = moves._replace(skeleton=moves.skeleton + shift[None, None])
    change = moved(problem, moves, turn_of(tree, 0)).skeleton - tree.cylinder.skeleton
    assert np.allclose(change[:2, 0], 0.0, atol=1e-9)  # roots stay on the scalp
    for index in (0, 1):
        assert np.allclose(change[index, 1:], shift[None], atol=1e-6)
    # Knots far from the roots see a parent that was shifted, and hardly turned.
    assert np.allclose(change[2:, 4:], shift[None, None], atol=1e-3)
    only = moved(problem, moves, turn_of(tree, 1)).skeleton - tree.cylinder.skeleton
    assert np.allclose(only[:2], 0.0, atol=1e-9)
    assert np.allclose(only[2:, 1:], shift[None, None], atol=1e-6)


def off_strand(found, truth):
    """Return how far points are from the true strands; along them is no error."""
    start, end = truth[:, None, :-1], truth[:, None, 1:]
    along, away = end - start, found[:, :, None] - start
    share = (away * along).sum(-1) / (along**2).sum(-1)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    return np.linalg.norm(found[:, :, None] - nearest, axis=-1).min(axis=-1)


CONFIG = RefineConfig(rounds=2, steps=15, points=POINTS)


@pytest.mark.slow
def test_segments_are_stretched_by_how_much_longer_they_are():
    rng = np.random.default_rng(0)
    strands = jnp.asarray(np.cumsum(rng.normal(size=(5, 9, 3)), axis=1))
    moved_away = strands + jnp.array([[[1.0, -2.0, 3.0]]])
    assert np.abs(np.asarray(stretched(strands, moved_away))).max() < 1e-6
    assert np.allclose(stretched(strands, 1.3 * strands), 0.3, atol=1e-6)
    one_longer = strands.at[2, 8].add(strands[2, 8] - strands[2, 7])
    expected = np.zeros((5, 8))
    expected[2, 7] = 1.0
    assert np.allclose(stretched(strands, one_longer), expected, atol=1e-6)


def test_turns_are_squares_of_chords_between_directions():
    angle = np.radians([0.0, 0.0, 90.0, 270.0, 300.0])
    ways = 0.01 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    strand = np.concatenate([np.zeros((1, 3)), np.cumsum(ways, axis=0)])
    found = np.asarray(turns(jnp.asarray(strand[None])))[0]
    # Straight on, a right angle, back, and 30 degrees, whose chord is nearly the angle.
    assert np.allclose(found, [0.0, 2.0, 4.0, 2.0 - np.sqrt(3.0)], atol=1e-3)
    assert np.isclose(np.sqrt(found[3]), np.radians(30.0), rtol=0.02)


def test_strands_that_stand_still_have_a_gradient():
    strands = jnp.zeros((2, 5, 3)).at[0, 2:].set(0.01)
    gradient = jax.grad(lambda p: jnp.sum(turns(p)))(strands)
    assert np.isfinite(np.asarray(gradient)).all()


def test_skeletons_do_not_turn_to_and_fro_between_points_of_strands(tree, scene):
    taken, samples, maps, head = scene
    truth = strands_of(single(tree), samples).reshape(-1, 3)
    aside = 0.006 * (-1.0) ** np.arange(KNOTS)
    aside[0] = 0.0
    zigzag = jnp.asarray(aside[None, :, None] * [1.0, 0.0, -1.0])
    wrong = eqx.tree_at(
        lambda x: x.cylinder.skeleton, tree, tree.cylinder.skeleton + zigzag
    )
    # Each strand has a point at every other knot.
    few = dataclasses.replace(CONFIG, points=KNOTS // 2)
    given = samples, Photographs(taken.views, taken.depths, maps), head, truth
    found = refine(single(wrong), *given, few)
    before, after = (float(turns(t.cylinder.skeleton).mean()) for t in (wrong, found))
    assert after < 0.5 * before


def straight_clusters(tree, lengths, width):
    """Return the clusters of a tree, straight, with round sections of one width."""
    straight = jnp.linspace(0.0, 1.0, KNOTS)[:, None] * jnp.array([[0.0, 1.0, 0.0]])
    count = tree.count
    return eqx.tree_at(
        lambda c: (c.skeleton, c.radius, c.offset, c.scale, c.shear),
        tree.cylinder,
        (
            jnp.asarray(lengths)[:, None, None] * straight[None],
            jnp.full((count, KNOTS), 2.0 * width),
            jnp.zeros_like(tree.cylinder.offset),
            jnp.full((count, KNOTS, 2), 0.5),
            jnp.zeros((count, KNOTS)),
        ),
    )


def test_clusters_of_close_knots_move_slowly(tree):
    lengths = np.array([1e-6, 0.02, 0.05, 0.07, 0.2, 1.0])
    apart = lengths / (KNOTS - 1)
    expected = np.clip(apart / FULL_PACE, LEAST_PACE, 1.0)
    assert expected.max() == 1.0 and expected[1] < expected[2] < 1.0
    found = paces(straight_clusters(tree, lengths, 1e-4))
    # Knots count as a tenth of a millimetre apart where they are one.
    assert np.isclose(found[0], 1e-4 / FULL_PACE, rtol=1e-3)
    assert np.allclose(found[1:], expected[1:], rtol=1e-3)


def test_clusters_wider_than_long_move_slowly(tree):
    lengths = np.full(6, (KNOTS - 1) * FULL_PACE)
    for width in (0.5, 0.1, 0.05, 0.01):
        found = paces(straight_clusters(tree, lengths, width))
        expected = min(FULL_PACE / (STEADY * width), 1.0)
        assert np.allclose(found, expected, rtol=1e-3)


def test_a_displaced_tree_comes_back(tree, scene):
    taken, samples, maps, head = scene
    truth = strands_of(single(tree), samples)
    t = jnp.linspace(0.0, 1.0, KNOTS)[None, :, None]
    away = t * jnp.array([[[0.007, 0.0, 0.007]]])
    wrong = eqx.tree_at(
        lambda x: x.cylinder.skeleton, tree, tree.cylinder.skeleton + away
    )
    before = off_strand(strands_of(single(wrong), samples), truth)
    shares = []
    found = refine(
        single(wrong),
        samples,
        Photographs(taken.views, taken.depths, maps),
        head,
        truth.reshape(-1, 3),
        CONFIG,
        progress=shares.append,
    )
    after = off_strand(strands_of(found, samples), truth)
    assert before.mean() > 0.005
    assert after.mean() < 0.5 * before.mean()
    assert np.allclose(shares, [0.25, 0.5, 0.75, 1.0])
    roots = found.cylinder.skeleton[:2, 0]
    assert np.allclose(roots, tree.cylinder.skeleton[:2, 0], atol=1e-6)


@pytest.mark.slow
def test_the_true_tree_stays_where_it_is(tree, scene):
    taken, samples, maps, head = scene
    truth = strands_of(single(tree), samples)
    seen = Photographs(taken.views, taken.depths, maps)
    places = truth.reshape(-1, 3)
    found = refine(single(tree), samples, seen, head, places, CONFIG)
    after = off_strand(strands_of(found, samples), truth)
    assert after.mean() < 0.001


@pytest.mark.slow
def test_clusters_that_only_fill_the_arrays_change_nothing(tree, scene):
    taken, samples, maps, head = scene
    places = strands_of(single(tree), samples).reshape(-1, 3)
    given = samples, Photographs(taken.views, taken.depths, maps), head, places
    # Each step more multiplies what rounding does by thousands.
    config = RefineConfig(rounds=1, steps=1, points=POINTS)
    plain = refine(single(tree), *given, config)
    roomy = refine(single(tree), *given, config, room=11)
    assert roomy.parent == plain.parent
    for mine, other in zip(jax.tree.leaves(roomy), jax.tree.leaves(plain), strict=True):
        assert np.allclose(mine, other, atol=1e-6)


@pytest.mark.slow
def test_the_lowest_level_moves_alone_where_that_is_asked(tree, scene):
    taken, samples, maps, head = scene
    places = strands_of(single(tree), samples).reshape(-1, 3)
    given = samples, Photographs(taken.views, taken.depths, maps), head, places
    config = RefineConfig(rounds=1, steps=2, points=POINTS, lowest_alone=True)
    shares = []
    found = refine(single(tree), *given, config, progress=shares.append)
    change = np.abs(found.cylinder.skeleton - single(tree).cylinder.skeleton)
    assert change[:2].max() == 0.0 and change[2:].max() > 1e-5
    assert shares == [1.0]


def with_zeros(rows, count):
    spare = [(0, count - len(rows)), *[(0, 0)] * (rows.ndim - 1)]
    return jnp.asarray(np.pad(rows, spare), jnp.float32)


@pytest.mark.slow
def test_priors_weigh_as_much_where_arrays_hold_more_clusters(tree, scene):
    """The first step of Adam goes by the sign of all that draws a number."""
    taken, samples, maps, volume = scene
    config, tree = RefineConfig(points=POINTS), single(tree)
    strands = np.asarray(strands_of(tree, samples), np.float64)
    found = Found(
        jnp.asarray(seen_segments(strands, taken.views, taken.depths)),
        find_pulls(strands, taken.views, taken.depths, 0),
        find_gaps(strands, strands.reshape(-1, 3), 0),
    )
    rng = np.random.default_rng(0)
    sizes = config.sigma_move, 0.1, 0.1, 0.1
    start = [
        size * rng.normal(size=zero.shape)
        for size, zero in zip(sizes, no_moves(tree), strict=True)
    ]
    after = []
    for room in (0, 11):
        problem = problem_of(tree, samples, maps, volume, room)
        moves = Moves(*(with_zeros(one, len(problem.level)) for one in start))
        before = grow_placed(problem.cylinder, problem.placed, POINTS)
        turn, one = turn_of(tree, 1, room), jnp.asarray(1, jnp.int32)
        moved_on = descend(problem, before, moves, found, turn, one, config)
        after.append([np.asarray(leaf)[: tree.count] for leaf in moved_on])
    for mine, other in zip(*after, strict=True):
        assert np.allclose(mine, other, atol=1e-6)


@pytest.mark.slow
def test_a_refinement_that_has_had_enough_stops_after_the_round(tree, scene):
    taken, samples, maps, head = scene
    places = strands_of(single(tree), samples).reshape(-1, 3)
    given = samples, Photographs(taken.views, taken.depths, maps), head, places
    config = RefineConfig(rounds=2, steps=3, points=POINTS)
    shares: list[float] = []
    none = refine(single(tree), *given, config, shares.append, enough=lambda: True)
    assert shares == []
    for mine, other in zip(
        jax.tree.leaves(none), jax.tree.leaves(single(tree)), strict=True
    ):
        assert np.allclose(mine, other, atol=1e-6)
    one = refine(
        single(tree), *given, config, shares.append, enough=lambda: bool(shares)
    )
    assert shares == [0.25]
    assert np.isfinite(strands_of(one, samples)).all()
    change = one.cylinder.skeleton - none.cylinder.skeleton
    assert np.abs(np.asarray(change)).max() > 1e-4
