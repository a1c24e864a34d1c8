"""Coons patches: surfaces between four boundary curves."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, ScalarLike

from .curve import catmull_rom

# Corners further apart than this share of the patch's size do not meet.
GAP = 1e-4


class CoonsPatch(eqx.Module):
    r"""A surface between four boundary curves [Kim02, appendix 3.A]. Metres.

    $S(s,t) = (1-t) U_1(s) + t U_2(s) + (1-s) L(t) + s R(t)$ with
    $L(t) = V_1(t) - (1-t) V_1(0) - t V_1(1)$ and R alike from $V_2$.

    That it runs through its boundaries follows from the ends alone: L and R vanish at
    t = 0 and 1, which leaves $U_1$ and $U_2$; at s = 0, $(1-t) U_1(0) + t U_2(0)$ is
    what L takes off $V_1$ as long as $U_1(0) = V_1(0)$ and $U_2(0) = V_1(1)$; at s = 1
    alike. So the appendix is right as printed where the corners meet, and only there:
    `coons_patch` checks them.

    Attributes:
        u1: $U_1(s)$, the boundary t = 0: any callable from a number to a point. To be
            fitted or moved under `jit`, it must be a pytree, such as
            `jax.tree_util.Partial(catmull_rom, control)`.
        u2: $U_2(s)$, the boundary t = 1.
        v1: $V_1(t)$, the boundary s = 0.
        v2: $V_2(t)$, the boundary s = 1.
    """

    u1: Callable
    u2: Callable
    v1: Callable
    v2: Callable

    def __call__(self, s: ScalarLike, t: ScalarLike) -> Float[Array, " 3"]:
        """Return the point S(s, t)."""
        s, t = jnp.asarray(s), jnp.asarray(t)
        left = off_chord(self.v1, t)
        right = off_chord(self.v2, t)
        ruled = (1.0 - t) * self.u1(s) + t * self.u2(s)
        return ruled + (1.0 - s) * left + s * right


def off_chord(curve: Callable, t: Float[Array, ""]) -> Float[Array, " 3"]:
    """Return how far a boundary curve lies off the straight line between its ends."""
    start, end = curve(jnp.zeros_like(t)), curve(jnp.ones_like(t))
    return curve(t) - (1.0 - t) * start - t * end


def coons_patch(
    u1: Float[Array, "u1_knots 3"],
    u2: Float[Array, "u2_knots 3"],
    v1: Float[Array, "v1_knots 3"],
    v2: Float[Array, "v2_knots 3"],
) -> CoonsPatch:
    """Return the patch between four Catmull-Rom curves. Runs outside `jit`.

    Args:
        u1: Control points of the boundary t = 0, from s = 0 to 1; for hair, the roots.
        u2: Control points of the boundary t = 1; for hair, the tips.
        v1: Control points of the boundary s = 0, from t = 0 to 1.
        v2: Control points of the boundary s = 1.

    Raises:
        ValueError: If the curves do not meet at the corners.
    """
    corners = {
        "u1 begins and v1 begins": (u1[0], v1[0]),
        "u1 ends and v2 begins": (u1[-1], v2[0]),
        "u2 begins and v1 ends": (u2[0], v1[-1]),
        "u2 ends and v2 ends": (u2[-1], v2[-1]),
    }
    every = np.concatenate([np.asarray(c) for c in (u1, u2, v1, v2)])
    size = float(np.linalg.norm(np.ptp(every, axis=0)))
    for where, (a, b) in corners.items():
        gap = float(np.linalg.norm(np.asarray(a) - np.asarray(b)))
        if gap > GAP * size:
            raise ValueError(
                f"the boundaries of a Coons patch must be closed, but where {where} "
                f"there is a gap of {gap:.3g} m; let both curves share that point."
            )
    curves = [jax.tree_util.Partial(catmull_rom, c) for c in (u1, u2, v1, v2)]
    return CoonsPatch(*curves)
