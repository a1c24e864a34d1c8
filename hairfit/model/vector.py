"""Vector algebra whose gradients stay finite where vectors vanish."""

import jax.numpy as jnp
from jaxtyping import Array, Float

# A vector shorter than this (metres, or no unit) counts as zero. Its square is still
# a normal float32.
TINY = 1e-12


def norm(v: Float[Array, "*batch axes"]) -> Float[Array, "*batch"]:
    """Return the lengths of vectors; at zero the gradient is zero, not NaN."""
    square = jnp.sum(v * v, axis=-1)
    some = square > TINY**2
    return jnp.where(some, jnp.sqrt(jnp.where(some, square, 1.0)), 0.0)


def unit(
    v: Float[Array, "*batch axes"], default: Float[Array, "*batch axes"]
) -> Float[Array, "*batch axes"]:
    """Return `v` scaled to length 1, or `default` where `v` vanishes."""
    square = jnp.sum(v * v, axis=-1, keepdims=True)
    some = square > TINY**2
    return jnp.where(some, v / jnp.sqrt(jnp.where(some, square, 1.0)), default)


def perpendicular(axis: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Return some unit vector perpendicular to the unit vector `axis`.

    One of the two in closed form by Duff and others [2017, Building an orthonormal
    basis, revisited].
    """
    x, y, z = axis
    sign = jnp.where(z < 0.0, -1.0, 1.0).astype(axis.dtype)
    share = -1.0 / (sign + z)
    return jnp.stack([x * y * share, sign + y * y * share, -y])


def reject(
    v: Float[Array, " 3"], axis: Float[Array, " 3"], tolerance: float = 1e-4
) -> Float[Array, " 3"]:
    """Return the direction of `v` perpendicular to the unit vector `axis`.

    Where `v` is parallel to `axis` within `tolerance` radians, or vanishes, any
    perpendicular will do.
    """
    along = unit(v, axis)
    rest = along - jnp.dot(along, axis) * axis
    apart = jnp.sum(rest * rest) > tolerance**2
    fallback = perpendicular(axis)
    return jnp.where(apart, unit(jnp.where(apart, rest, fallback), fallback), fallback)
