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
    first = jnp.floor(position)
    f = position - first
    i = jnp.mod(first, ANGLES).astype(int)
    j = jnp.mod(i + 1, ANGLES)
    return jnp.asarray(radius) + (1.0 - f) * offset[i] + f * offset[j]
