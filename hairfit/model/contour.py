"""Star-shaped contours: the cross-sections of clusters, and where they are rooted."""

import jax.numpy as jnp
from jaxtyping import Array, Float, ScalarLike

ANGLES = 32


def contour_radius(
    radius: ScalarLike, offset: Float[Array, " 32"], theta: ScalarLike
) -> Float[Array, ""]:
    r"""Return the contour's distance from its centre, $R(\theta) = s + \hat R(\theta)$.

    The offset is interpolated linearly between the 32 even angles $2 \pi i / 32$
    [Kim02, section 4.2.2].

    Args:
        radius: Global radius $s$.
        offset: Offsets $\hat R(\theta_i)$ from `radius`.
        theta: Angle, in radians; any turn.
    """
    position = jnp.asarray(theta, offset.dtype) * (ANGLES / (2.0 * jnp.pi))
    # Hats over the angles. An index and a share would be quicker to say, but a compiler
    # may compute the position twice, and rounding then put them into different steps.
    away = jnp.mod(position - jnp.arange(ANGLES, dtype=offset.dtype), ANGLES)
    weights = jnp.maximum(1.0 - jnp.minimum(away, ANGLES - away), 0.0)
    return jnp.asarray(radius) + jnp.sum(weights * offset)
