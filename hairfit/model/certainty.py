"""How sure a fit is of each cluster of a tree."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, ScalarLike

# What is said of a cluster that no fit has measured: metres, radians.
UNKNOWN_POSITION = 0.05
UNKNOWN_ANGLE = 1.0


class TreeConfidence(eqx.Module):
    """What a fit knows of each cluster; a cluster with children holds a mean of them.

    It tells of the fit: later edits keep it as it is.

    Attributes:
        sigma_position: Standard deviation to expect of where hair runs, in each
            direction across it, in metres: root mean square over the knots.
        sigma_angle: The same of its direction, in radians.
        photographed: Share of what is known that photographs say, against what is
            assumed of all hair, from 0 to 1.
    """

    sigma_position: Float[Array, " clusters"]
    sigma_angle: Float[Array, " clusters"]
    photographed: Float[Array, " clusters"]

    def chance(self, radius: float, angle: float) -> Float[Array, " clusters"]:
        r"""Return how likely hair runs as each cluster says, up to a tolerance.

        Both errors have two directions across the hair, so that with Gaussian errors
        the chance is $(1 - e^{-radius^2 / 2 \sigma_p^2}) (1 - e^{-angle^2 / 2
        \sigma_a^2})$.

        Args:
            radius: Largest distance that counts as right, in metres.
            angle: Largest angle that counts as right, in radians.
        """
        place = _within(radius, self.sigma_position)
        return place * _within(angle, self.sigma_angle)


@jax.jit
def _within(limit: ScalarLike, sigma: Float[Array, " clusters"]) -> Array:
    """Return how likely an error in two directions is smaller than a limit."""
    return -jnp.expm1(-0.5 * (limit / jnp.maximum(sigma, 1e-9)) ** 2)


def unknown_confidence() -> TreeConfidence:
    """Return what is said of one cluster that no fit has measured."""
    values = (UNKNOWN_POSITION, UNKNOWN_ANGLE, 0.0)
    return TreeConfidence(*(jnp.asarray([value], jnp.float32) for value in values))


def heirs(count: int, parent: Sequence[int]) -> Int[np.ndarray, " clusters"]:
    """Return whose confidence and locks each cluster has after some were added.

    Nothing was measured of the added ones: each is as certain as the cluster that it
    belongs to, and unknown without one.

    Args:
        count: How many clusters there were.
        parent: The parent of each added cluster, -1 for none; it may be an added one
            that stands before.

    Returns:
        An index for each cluster, below `count`; `count` itself is the unknown.
    """
    source = list(range(count))
    for above in parent:
        source.append(source[above] if above >= 0 else count)
    return np.asarray(source, int)
