import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.test_util import check_grads

from hairfit import model
from hairfit.model import GeneralizedCylinder
from hairfit.model.cylinder import frames_of

cylinder_point = jax.jit(model.cylinder_point)
cylinder_knots = jax.jit(model.cylinder_knots)
slope = jax.jit(jax.jacrev(model.cylinder_point, argnums=(0, 1, 2, 3)))

X, Y, Z = jnp.eye(3)


def straight(knots=5, radius=0.5) -> GeneralizedCylinder:
    """Return a cylinder of 2 m along z, with its zero angle at x."""
    return GeneralizedCylinder(
        skeleton=jnp.linspace(0.0, 2.0, knots)[:, None] * Z[None],
        normal=X,
        radius=jnp.full(knots, radius),
        offset=jnp.zeros((knots, 32)),
        scale=jnp.ones((knots, 2)),
        twist=jnp.zeros(knots),
        shear=jnp.zeros(knots),
    )


@pytest.fixture(scope="module")
def bent() -> GeneralizedCylinder:
    rng = np.random.default_rng(1)
    normal = {
        "skeleton": np.asarray(straight().skeleton) + 0.1 * rng.normal(size=(5, 3)),
        "radius": 0.5 + 0.1 * rng.normal(size=5),
        "offset": 0.05 * rng.normal(size=(5, 32)),
        "scale": 1.0 + 0.2 * rng.normal(size=(5, 2)),
        "twist": rng.normal(size=5),
        "shear": 0.2 * rng.normal(size=5),
    }
    return GeneralizedCylinder(
        normal=X, **{name: jnp.asarray(value) for name, value in normal.items()}
    )


def test_a_straight_cylinder_is_one():
    theta = 0.4
    spoke = 0.5 * (jnp.cos(theta) * X + jnp.sin(theta) * Y)
    got = cylinder_point(straight(), 1.0, theta, 0.3)
    assert jnp.allclose(got, spoke + 0.6 * Z, atol=1e-12)
    got = cylinder_point(straight(), 0.25, theta, 1.0)
    assert jnp.allclose(got, 0.25 * spoke + 2.0 * Z, atol=1e-12)


def test_scale_twist_and_shear_are_equation_4_4_by_hand():
    cylinder = eqx.tree_at(
        lambda c: (c.scale, c.twist, c.shear, c.offset),
        straight(),
        (
            jnp.tile(jnp.array([[2.0, 3.0]]), (5, 1)),
            jnp.linspace(0.0, 1.0, 5),
            jnp.full(5, 0.5),
            jnp.full((5, 32), 0.1),
        ),
    )
    r, theta, t = 0.7, 0.2, 0.625  # between the knots at 0.5 and 0.75
    x = r * 0.6 * np.cos(theta + t)
    y = r * 0.6 * np.sin(theta + t)
    want = jnp.array([2.0 * x + 0.5 * y, 3.0 * y, 2.0 * t])
    assert jnp.allclose(cylinder_point(cylinder, r, theta, t), want, atol=1e-12)


def test_contours_are_interpolated_along_the_skeleton():
    cylinder = eqx.tree_at(lambda c: c.radius, straight(), jnp.arange(1.0, 6.0))
    got = cylinder_point(cylinder, 1.0, 0.0, 0.125)  # half way to the second knot
    assert jnp.allclose(got, jnp.array([1.5, 0.0, 0.25]), atol=1e-12)


def test_knots_are_points_of_the_cylinder(bent):
    knots = cylinder_knots(bent, 0.8, 2.0)
    t = jnp.linspace(0.0, 1.0, 5)
    points = jnp.stack([cylinder_point(bent, 0.8, 2.0, at) for at in t])
    assert jnp.allclose(knots, points, atol=1e-9)


def test_a_bend_does_not_thin_the_cluster():
    angle = jnp.linspace(0.0, 2.0, 5)
    arc = jnp.stack([jnp.cos(angle), jnp.zeros(5), jnp.sin(angle)], axis=1)
    cylinder = eqx.tree_at(lambda c: (c.skeleton, c.normal), straight(), (arc, X))
    for t in (0.1, 0.375):
        centre = cylinder_point(cylinder, 0.0, 0.0, t)
        for theta in (0.0, 1.0):
            out = cylinder_point(cylinder, 1.0, theta, t) - centre
            assert jnp.allclose(jnp.linalg.norm(out), 0.5, atol=1e-9)


def test_gradients_of_a_bent_cylinder(bent):
    check_grads(cylinder_point, (bent, 0.8, 2.0, 0.3), order=1, modes=["rev"])
    check_grads(cylinder_knots, (bent, 0.8, 2.0), order=1, modes=["rev"])


@pytest.mark.parametrize("r", [0.8, 0.0])
@pytest.mark.parametrize("radius", [0.5, 0.0])
def test_gradients_of_a_straight_cylinder_of_any_radius(r, radius):
    arguments = (straight(radius=radius), r, 2.0, 0.3)
    check_grads(cylinder_point, arguments, order=1, modes=["rev"])


def test_gradients_are_finite_for_a_normal_along_the_skeleton():
    cylinder = eqx.tree_at(lambda c: c.normal, straight(radius=0.0), Z)
    for leaf in jax.tree.leaves(slope(cylinder, 0.0, 0.0, 0.3)):
        assert jnp.all(jnp.isfinite(leaf))


def test_single_precision_stays_single():
    cylinder = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), straight())
    assert cylinder_point(cylinder, 1.0, 0.0, 0.5).dtype == jnp.float32


@pytest.mark.parametrize("count", [0, 1, 3, 70])
def test_frames_of_many_clusters_are_those_of_each(bent, count):
    many = jax.tree.map(lambda x: jnp.tile(x[None], (count,) + (1,) * x.ndim), bent)
    turned = jnp.arange(float(count))[:, None] * Y[None] + X[None]
    many = eqx.tree_at(lambda c: c.normal, many, turned)
    found = frames_of(many)
    assert found.normal.shape == (count, 5, 3)
    for i in range(0, count, 23):
        alone = model.cylinder_frames(model.cluster(many, i))
        for mine, one in zip(found, alone, strict=True):
            assert jnp.allclose(mine[i], one, atol=1e-12)
