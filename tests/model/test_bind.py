import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from jax.test_util import check_grads

from hairfit.model import GeneralizedCylinder, cylinder_knots, cylinder_point
from hairfit.model.bind import (
    Bound,
    bind_point,
    bind_points,
    follow,
    update_point,
    update_points,
)
from hairfit.model.closest import follow_samples, make_axis
from hairfit.model.section import rotation

KNOTS = 6
points_of = jax.jit(jax.vmap(cylinder_point, (None, 0, 0, 0)))
content_of = jax.jit(
    jax.vmap(jax.vmap(cylinder_knots, (None, None, 0)), (0, None, None))
)
bind_one = jax.jit(bind_point)


@jax.jit
def slopes_of_binding(cylinder, p):
    def size(cylinder, p):
        bound = bind_point(cylinder, p)
        return bound.r + jnp.sin(bound.theta) + bound.t

    return jax.grad(size, argnums=(0, 1))(cylinder, p)


COUNT = 2  # of clusters that follow: one program for all tests


def random_cylinder(seed, bend=0.01) -> GeneralizedCylinder:
    """Return a bent cluster 20 cm long and 1 cm thick, with all that (4-4) has."""
    rng = np.random.default_rng(seed)
    up = 0.04 * np.arange(KNOTS)[:, None] * np.array([[0.0, 1.0, 0.0]])
    arrays = {
        "skeleton": up + bend * rng.normal(size=(KNOTS, 3)),
        "normal": np.array([1.0, 0.0, 0.2]),
        "radius": 0.01 + 0.001 * rng.normal(size=KNOTS),
        "offset": 0.001 * rng.normal(size=(KNOTS, 32)),
        "scale": 1.0 + 0.2 * rng.normal(size=(KNOTS, 2)),
        "twist": rng.normal(size=KNOTS).cumsum(),
        "shear": 0.2 * rng.normal(size=KNOTS),
    }
    return GeneralizedCylinder(**{k: jnp.asarray(v) for k, v in arrays.items()})


def straight(radius=0.01) -> GeneralizedCylinder:
    """Return a plain cluster of 20 cm along y, its zero angle at x."""
    along = jnp.linspace(0.0, 0.2, KNOTS)
    return GeneralizedCylinder(
        skeleton=along[:, None] * jnp.eye(3)[1:2],
        normal=jnp.eye(3)[0],
        radius=jnp.full(KNOTS, radius),
        offset=jnp.zeros((KNOTS, 32)),
        scale=jnp.ones((KNOTS, 2)),
        twist=jnp.zeros(KNOTS),
        shear=jnp.zeros(KNOTS),
    )


def within(cylinder, count, seed, low=-0.1, high=1.1):
    """Return random coordinates in a cluster and beyond its ends, and their points."""
    rng = np.random.default_rng(seed)
    r, theta = rng.uniform(0.05, 1.2, count), rng.uniform(-3, 3, count)
    t = rng.uniform(low, high, count)
    place = [jnp.asarray(x, cylinder.radius.dtype) for x in (r, theta, t)]
    return place, points_of(cylinder, *place)


def children_of(cylinder, seed) -> GeneralizedCylinder:
    """Return clusters that run beside a cluster's skeleton, stacked."""
    rng = np.random.default_rng(seed)
    off = 0.006 * rng.normal(size=(COUNT, 1, 3)) + 0.002 * rng.normal(
        size=(COUNT, KNOTS, 3)
    )
    many = [random_cylinder(seed + i) for i in range(COUNT)]
    skeletons = cylinder.skeleton[None] + jnp.asarray(off)
    stacked = jax.tree.map(lambda *x: jnp.stack(x), *many)
    return eqx.tree_at(lambda c: c.skeleton, stacked, skeletons)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000))
@example(4200)  # Newton's method and bisection take turns for long
@example(5154)
def test_points_return_from_their_coordinates(seed):
    """Also beyond the ends, and wherever the search gives no warning."""
    cylinder = random_cylinder(seed)
    _, p = within(cylinder, 64, seed)
    bound = bind_points(cylinder, p)
    apart = jnp.linalg.norm(update_points(cylinder, bound) - p, axis=1)
    assert jnp.all(jnp.where(bound.ambiguous, 0.0, apart) < 1e-9)
    assert jnp.mean(bound.ambiguous) < 0.3


def test_a_root_just_before_a_knot_is_found_from_a_sample_behind_it():
    # Of this cluster and point the closest sample is the first one behind a knot.
    cylinder = random_cylinder(260)
    _, p = within(cylinder, 64, 260)
    bound = bind_points(cylinder, p)
    assert not bool(bound.ambiguous[49])
    assert float(bound.t[49]) < 0.2
    apart = jnp.linalg.norm(update_points(cylinder, bound)[49] - p[49])
    assert float(apart) < 1e-12


def test_a_gently_bent_cluster_knows_the_coordinates_of_all_its_points():
    cylinder = random_cylinder(3, bend=0.003)
    (r, theta, t), p = within(cylinder, 64, 0)
    bound = bind_points(cylinder, p)
    assert not jnp.any(bound.ambiguous)
    assert jnp.allclose(bound.t, t, atol=1e-9)
    assert jnp.allclose(bound.r, r, atol=1e-9)
    assert jnp.allclose(jnp.cos(bound.theta - theta), 1.0, atol=1e-9)


def test_single_precision_is_good_to_a_micrometre():
    cylinder = random_cylinder(3, bend=0.003)
    cylinder = jax.tree.map(lambda x: x.astype(jnp.float32), cylinder)
    _, p = within(cylinder, 64, 0)
    bound = bind_points(cylinder, p)
    assert bound.r.dtype == jnp.float32
    apart = jnp.linalg.norm(update_points(cylinder, bound) - p, axis=1)
    assert jnp.max(apart) < 1e-6


def test_the_skeletons_point_is_the_closest_by_a_slow_search():
    cylinder = random_cylinder(5, bend=0.004)
    rng = np.random.default_rng(0)
    p = rng.uniform(-0.03, 0.03, (64, 3)) + [0, 0.1, 0]
    dense = np.linspace(0.0, 1.0, 8001)
    nought = jnp.zeros(len(dense))
    curve = np.asarray(points_of(cylinder, nought, nought, jnp.asarray(dense)))
    distance = np.linalg.norm(p[:, None] - curve[None], axis=2)
    bound = bind_points(cylinder, jnp.asarray(p))
    at = np.clip(np.asarray(bound.t), 0, 1)
    mine = np.linalg.norm(p - curve[np.rint(at * 8000).astype(int)], axis=1)
    clear = ~np.asarray(bound.ambiguous)
    assert clear.sum() > 40
    # The interpolated tangent is not exactly the curve's: so neither are the points.
    assert np.all(mine[clear] < distance.min(axis=1)[clear] * 1.05 + 1e-4)


def test_points_off_a_straight_cluster_are_known_by_hand():
    cylinder = eqx.tree_at(
        lambda c: (c.scale, c.twist),
        straight(),
        (jnp.tile(jnp.array([[2.0, 0.5]]), (KNOTS, 1)), jnp.full(KNOTS, 0.3)),
    )
    # N is x, T is y, so B = T x N is -z.
    p = jnp.array([[0.01, 0.05, 0.0], [0.0, 0.25, -0.01], [0.02, -0.1, 0.0]])
    bound = bind_points(cylinder, p)
    assert jnp.allclose(bound.t, jnp.array([0.25, 1.25, -0.5]), atol=1e-12)
    assert jnp.allclose(bound.r, jnp.array([0.5, 2.0, 1.0]), atol=1e-12)
    angle = jnp.array([0.0, np.pi / 2, 0.0]) - 0.3
    assert jnp.allclose(bound.theta, angle, atol=1e-12)


def test_points_beyond_the_radius_of_curvature_are_ambiguous():
    angle = jnp.linspace(0.0, 2.0, KNOTS)
    arc = 0.1 * jnp.stack([jnp.cos(angle), jnp.sin(angle), 0 * angle], axis=1)
    cylinder = eqx.tree_at(lambda c: c.skeleton, straight(), arc)
    middle = jnp.array([np.cos(1.0), np.sin(1.0), 0.0])
    p = jnp.array([0.05, 0.15, -0.02])[:, None] * middle[None]
    got = bind_points(cylinder, p).ambiguous
    assert got.tolist() == [False, False, True]


def test_a_point_between_two_stretches_is_ambiguous():
    x = jnp.array([0.0, 0.0, 0.0, 0.1, 0.1, 0.1])
    y = jnp.array([0.0, 0.1, 0.2, 0.2, 0.1, 0.0])
    hairpin = jnp.stack([x, y, 0 * x], axis=1)
    cylinder = eqx.tree_at(lambda c: c.skeleton, straight(), hairpin)
    p = jnp.array([[0.05, 0.08, 0.0], [0.03, 0.08, 0.0]])
    assert bind_points(cylinder, p).ambiguous.tolist() == [True, False]


@pytest.mark.parametrize("what", ["scale", "radius", "skeleton"])
def test_what_is_flat_is_lost_but_finite(what):
    cylinder = straight()
    flat = eqx.tree_at(lambda c: getattr(c, what), cylinder, replace_fn=jnp.zeros_like)
    p = jnp.array([[0.005, 0.05, 0.003], [0.0, 0.0, 0.0]])
    for point in p:
        results = bind_one(flat, point), slopes_of_binding(flat, point)
        for leaf in jax.tree.leaves(results):
            assert jnp.all(jnp.isfinite(leaf))
    if what != "skeleton":
        bound = bind_points(flat, p)
        assert jnp.allclose(bound.r, 0.0)
        back = update_points(flat, bound)  # the point of the skeleton beside it
        assert jnp.allclose(back, p * jnp.array([[0.0, 1.0, 0.0]]), atol=1e-12)


@pytest.mark.slow
def test_binding_and_updating_have_gradients():
    before, after = random_cylinder(3, bend=0.004), random_cylinder(4, bend=0.004)

    def moved(before, after, p):
        return update_point(after, bind_point(before, p))

    _, p = within(before, 64, 1)
    for point in p[:3]:
        check_grads(
            jax.jit(moved), (before, after, point), order=1, modes=["rev"], eps=1e-7
        )


def test_a_binder_that_stays_moves_nothing():
    binder = random_cylinder(1)
    bound = children_of(binder, 2)
    for whole in (False, True):
        same = follow(binder, binder, bound, whole_skeleton=whole)
        for got, want in zip(
            jax.tree.leaves(same), jax.tree.leaves(bound), strict=True
        ):
            assert jnp.allclose(got, want, atol=1e-9)


@pytest.mark.parametrize("whole", [False, True])
def test_a_rigid_motion_takes_everything_along(whole):
    binder = random_cylinder(1)
    bound = children_of(binder, 2)
    turn = rotation(jnp.array([0.6, 0.0, 0.8]), jnp.array(1.9))
    shift = jnp.array([0.1, -0.2, 0.3])
    after = eqx.tree_at(
        lambda c: (c.skeleton, c.normal),
        binder,
        (binder.skeleton @ turn.T + shift[None], turn @ binder.normal),
    )
    there = follow(binder, after, bound, whole_skeleton=whole)
    theta = jnp.linspace(0.0, 6.0, 5)
    want = content_of(bound, 0.9, theta) @ turn.T + shift[None, None, None]
    assert jnp.allclose(content_of(there, 0.9, theta), want, atol=1e-9)


def test_content_follows_scale_twist_and_stretch_as_if_it_were_bound_itself():
    """Exactly where the change is linear and clusters run along their binder."""
    before = straight()
    after = eqx.tree_at(
        lambda c: (c.skeleton, c.scale, c.twist, c.radius),
        before,
        (
            1.5 * before.skeleton,
            jnp.tile(jnp.array([[2.0, 0.7]]), (KNOTS, 1)),
            jnp.full(KNOTS, 2.5),
            2.0 * before.radius,
        ),
    )
    bound = children_of(before, 0)
    off = jnp.array([[0.004, 0, 0], [0.003, 0, -0.006]])
    bound = eqx.tree_at(
        lambda c: c.skeleton, bound, before.skeleton[None] + off[:, None]
    )
    there = follow(before, after, bound)
    theta = jnp.linspace(0.0, 6.0, 5)
    content = content_of(bound, 0.9, theta).reshape(-1, 3)
    want = update_points(after, bind_points(before, content))
    got = content_of(there, 0.9, theta).reshape(-1, 3)
    assert jnp.allclose(got, want, atol=1e-9)


def test_twist_of_many_turns_is_carried_to_the_clusters():
    before = straight()
    after = eqx.tree_at(lambda c: c.twist, before, jnp.linspace(0.0, 25.0, KNOTS))
    there = follow(before, after, jax.tree.map(lambda x: jnp.stack([x, x]), before))
    assert jnp.allclose(there.twist[0], after.twist, atol=1e-9)


def test_held_control_points_stay_with_their_cross_sections():
    before, after = random_cylinder(1), random_cylinder(2)
    bound = children_of(before, 5)
    held = jnp.zeros((COUNT, KNOTS), bool).at[:, :2].set(True)
    there = follow(before, after, bound, held=held)
    assert jnp.array_equal(there.skeleton[:, :2], bound.skeleton[:, :2])
    assert jnp.array_equal(there.normal, bound.normal)
    free = follow(before, after, bound)
    assert jnp.array_equal(there.skeleton[:, 2:], free.skeleton[:, 2:])
    theta = jnp.linspace(0.0, 6.0, 5)
    at_root = [content_of(c, 0.9, theta)[:, :, 0] for c in (there, bound)]
    assert jnp.allclose(at_root[0], at_root[1], atol=1e-9)


def test_a_binder_without_radius_is_an_axis():
    before = straight(radius=0.0)
    after = eqx.tree_at(lambda c: c.twist, before, jnp.full(KNOTS, np.pi / 2))
    bound = children_of(before, 3)
    there = follow(before, after, bound)
    turn = jnp.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # N = x becomes B = -z
    assert jnp.allclose(there.skeleton, bound.skeleton @ turn.T, atol=1e-12)


@pytest.mark.slow
def test_following_has_gradients():
    before, after = random_cylinder(3, bend=0.004), random_cylinder(4, bend=0.004)
    bound = children_of(before, 3)

    def result(before, after, bound):
        return jax.tree.leaves(follow(before, after, bound))

    check_grads(result, (before, after, bound), order=1, modes=["rev"], eps=1e-7)


def test_whole_skeletons_do_not_drift_where_single_points_do():
    """A hair inside a strong bend, straightened: its knots stay in their order."""
    binder = bend()
    there = {
        whole: follow(binder, straight(), inside_of(binder), whole_skeleton=whole)
        for whole in (False, True)
    }
    even = 0.2 / (KNOTS - 1)
    step = {k: jnp.diff(c.skeleton[0, :, 1]) / even for k, c in there.items()}
    assert jnp.min(step[False]) < -1.0
    assert jnp.max(step[False]) > 2.0
    assert jnp.all((step[True] > 0.5) & (step[True] < 1.5))


def bend() -> GeneralizedCylinder:
    """Return a cluster with a sharp right angle in its middle."""
    x = jnp.array([0.0, 0.0, 0.005, 0.035, 0.08, 0.12])
    return eqx.tree_at(
        lambda c: c.skeleton, straight(), jnp.stack([x, x[::-1], 0 * x], 1)
    )


def inside_of(binder) -> GeneralizedCylinder:
    """Return one cluster that runs in the binder, inside of its bend."""
    t = jnp.linspace(0.0, 1.0, KNOTS)
    bound = Bound(jnp.full(KNOTS, 7.0), jnp.zeros(KNOTS), t, jnp.zeros(KNOTS, bool))
    inside = eqx.tree_at(lambda c: c.skeleton, binder, update_points(binder, bound))
    return jax.tree.map(lambda x: jnp.stack([x, x]), inside)


def test_the_way_along_a_skeleton_is_the_best_of_all():
    """Dynamic programming against all ways that never go back."""
    skeleton = jnp.array([[0.0, 0, 0], [0.01, 0.02, 0.0], [0.03, 0.02, 0]])
    axis = make_axis(skeleton, jnp.eye(3))
    axis = axis._replace(sample=axis.sample[::2])
    p = jnp.array([[0.01, 0.01, 0], [0.0, 0.018, 0.0], [0.02, 0.0, 0.01]])
    got = np.asarray(jax.jit(follow_samples)(axis, p)).tolist()
    sample = np.asarray(axis.sample)
    along = np.r_[0, np.linalg.norm(np.diff(sample, axis=0), axis=1).cumsum()]
    step = np.linalg.norm(np.diff(p, axis=0), axis=1)

    def cost(way):
        near = ((np.asarray(p) - sample[way]) ** 2).sum()
        return near + ((np.diff(along[way]) - step) ** 2).sum()

    n = range(len(sample))
    ways = [[a, b, c] for a in n for b in n[a:] for c in n[b:]]
    assert got == min(ways, key=cost)
