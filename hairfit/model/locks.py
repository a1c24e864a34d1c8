"""Locks: hair of a cluster whose curls wind together."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

# How far curls run along the hair for a whole turn, for each metre of their radius.
PITCH = 6.0


class Locks(eqx.Module):
    """How the curls of each cluster's hair wind, beside what their radius says.

    Attributes:
        phase: Where about its hair the helix stands at each knot of a cluster, beside
            the turns that it has made, in radians: even it is a plain helix.
        hand: 1 for curls that wind to the right, -1 for those that wind to the left.
        pitch: Length of a turn, in radii; `PITCH` where hairs curl for themselves.
    """

    phase: Float[Array, "clusters knots"]
    hand: Float[Array, " clusters"]
    pitch: Float[Array, " clusters"]


class Winding(NamedTuple):
    """How the lock of each strand winds along it.

    Attributes:
        phase: Its phase at each point, in radians.
        hand: Its hand.
        pitch: Length of its turns, in radii.
    """

    phase: Float[Array, "strands points"]
    hand: Float[Array, " strands"]
    pitch: Float[Array, " strands"]


def unknown_locks(knots: int) -> Locks:
    """Return the lock of one cluster of which nothing is known."""
    one = jnp.ones(1, jnp.float32)
    return Locks(jnp.zeros((1, knots), jnp.float32), one, PITCH * one)


def mirrored(locks: Locks) -> Locks:
    """Return locks that wind the other way, as in a mirror."""
    return eqx.tree_at(lambda one: one.hand, locks, -locks.hand)


@functools.partial(jax.jit, static_argnames="points")
def wind_along(
    locks: Locks,
    owner: Int[Array, " strands"],
    eta: Float[Array, " strands"],
    points: int,
) -> Winding:
    """Return how strands wind with the locks of their clusters.

    Args:
        locks: The locks of all clusters.
        owner: The cluster of each strand, none (-1) as the first.
        eta: Share of the cluster's length that each strand reaches.
        points: Number of points of each strand.
    """
    mine = jnp.maximum(owner, 0)
    phase = locks.phase[mine].astype(eta.dtype)
    knots = jnp.linspace(0.0, 1.0, phase.shape[1], dtype=eta.dtype)
    t = eta[:, None] * jnp.linspace(0.0, 1.0, points, dtype=eta.dtype)[None]
    phase = jax.vmap(jnp.interp, (0, None, 0))(t, knots, phase)
    hand, pitch = (each[mine].astype(eta.dtype) for each in (locks.hand, locks.pitch))
    return Winding(phase, hand, pitch)
