"""Light at the border of a clear body."""

import jax.numpy as jnp
from jaxtyping import Array, Float, ScalarLike


def fresnel(
    cosine: Float[Array, ""], ior: ScalarLike, parallel: ScalarLike | None = None
) -> Float[Array, ""]:
    """Return the share of unpolarised light that a dielectric reflects.

    Args:
        cosine: Of the angle of incidence from outside, 0 or more.
        ior: Index of refraction inside, 1 or more.
        parallel: Index for the polarisation in the plane of incidence, where it is
            another one, as across an inclined fibre; `ior` by default.
    """
    sine = 1.0 - cosine**2
    other = ior if parallel is None else parallel
    within = inner_cosine(sine, ior)
    crossed = (cosine - ior * within) / (cosine + ior * within)
    within = inner_cosine(sine, other)
    flat = (other * cosine - within) / (other * cosine + within)
    return 0.5 * (crossed**2 + flat**2)


def inner_cosine(square: Float[Array, ""], ior: ScalarLike) -> Float[Array, ""]:
    """Return the cosine of the refracted angle, by Snell's law.

    Args:
        square: Square of the sine of the angle of incidence.
        ior: Index of refraction inside. Below 1 and beyond the critical angle the
            cosine is 0: all is reflected.
    """
    rest = 1.0 - square / ior**2
    inside = rest > 0.0
    return jnp.where(inside, jnp.sqrt(jnp.where(inside, rest, 1.0)), 0.0)
