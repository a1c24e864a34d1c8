import jax
import jax.numpy as jnp
import numpy as np
import pytest

from hairfit.model import GeneralizedCylinder, HairTree, Scalp, ScalpContour, plant


@pytest.fixture(scope="session")
def flat() -> Scalp:
    """A flat scalp of 1 m x 1 m in the plane y = 0; its normal is +y."""
    side = jnp.linspace(0.0, 1.0, 13)
    v, u = jnp.meshgrid(side, side)
    return Scalp(jnp.stack([v, jnp.zeros_like(u), u], axis=-1))


@pytest.fixture(scope="session")
def dome() -> Scalp:
    """The upper half, nearly, of a ball of 9 cm about the origin."""
    side = np.linspace(-1.0, 1.0, 13)
    x, z = np.meshgrid(side, side, indexing="ij")
    up = np.stack([x, np.full_like(x, 0.6), -z], axis=-1)
    return Scalp(jnp.asarray(0.09 * up / np.linalg.norm(up, axis=-1, keepdims=True)))


plant_all = jax.jit(jax.vmap(plant, (None, 0, None, None)), static_argnums=3)


@pytest.fixture
def make_tree():
    """Make a tree of circular contours, planted and bent at random."""

    def make(scalp, circles, parent, knots=6, seed=0, variation=0.0) -> HairTree:
        rng = np.random.default_rng(seed)
        contour = jax.vmap(ScalpContour)(
            jnp.asarray([c[:2] for c in circles], float),
            jnp.asarray([c[2] for c in circles], float),
            jnp.zeros((len(circles), 32)),
        )
        planted = plant_all(scalp, contour, 0.2, knots)
        bend = 0.01 * rng.normal(size=planted.skeleton.shape).cumsum(axis=1)
        cylinder = jax.vmap(GeneralizedCylinder)(
            planted.skeleton + jnp.asarray(bend),
            planted.normal,
            planted.radius,
            planted.offset,
            planted.scale,
            jnp.asarray(rng.normal(size=planted.twist.shape)),
            planted.shear,
        )
        return HairTree(
            scalp,
            contour,
            cylinder,
            jnp.full(len(circles), variation),
            tuple(parent),
        )

    return make
