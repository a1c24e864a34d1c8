"""Locks: hair of a cluster whose curls wind together."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int


class Locks(eqx.Module):
    """How the curls of each cluster's hair wind, beside what their radius says.

    Attributes:
        phase: Where about its hair the helix stands at each knot of a cluster, beside
            the turns that it has made, in radians: even it is a plain helix.
        hand: 1 for curls that wind to the right, -1 for those that wind to the left.
    """

    phase: Float[Array, "clusters knots"]
    hand: Float[Array, " clusters"]


def unknown_locks(knots: int) -> Locks:
    """Return the lock of one cluster of which nothing is known."""
    return Locks(jnp.zeros((1, knots), jnp.float32), jnp.ones(1, jnp.float32))


@functools.partial(jax.jit, static_argnames="points")
def phases_along(
    locks: Locks,
    owner: Int[Array, " strands"],
    eta: Float[Array, " strands"],
    points: int,
) -> Float[Array, "strands points"]:
    """Return the phase of each strand's lock at each of its points, in radians.

    Args:
        locks: The locks of all clusters.
        owner: The cluster of each strand, none (-1) as the first.
        eta: Share of the cluster's length that each strand reaches.
        points: Number of points of each strand.
    """
    phase = locks.phase[jnp.maximum(owner, 0)].astype(eta.dtype)
    knots = jnp.linspace(0.0, 1.0, phase.shape[1], dtype=eta.dtype)
    t = eta[:, None] * jnp.linspace(0.0, 1.0, points, dtype=eta.dtype)[None]
    return jax.vmap(jnp.interp, (0, None, 0))(t, knots, phase)
