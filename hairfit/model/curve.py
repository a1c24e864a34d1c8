"""Catmull-Rom curves, and polylines by arc length."""

import functools
import operator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, ScalarLike

from .vector import norm

# Products must be exact on accelerators too: by default some round to 10 bits.
EXACT = jax.lax.Precision.HIGHEST

# How the four control points around a segment weigh: coefficients of 1, f, f^2, f^3.
BASIS = (
    (0.0, -0.5, 1.0, -0.5),
    (1.0, 0.0, -2.5, 1.5),
    (0.0, 0.5, 2.0, -1.5),
    (0.0, 0.0, -0.5, 0.5),
)


def catmull_rom_weights(
    knots: int, t: Float[Array, " points"], derivative: int = 0
) -> Float[Array, "points knots"]:
    """Return the weights that turn control points into points of their curve.

    The curve is `weights @ control`: a uniform Catmull-Rom spline that runs through
    control point `k` at `t = k / (knots - 1)`. Its end tangents come from phantom
    points, the second point reflected in the first one (and alike at the end).

    Args:
        knots: Number of control points, 2 or more.
        t: Where to evaluate; outside [0, 1] the curve goes on along its end tangents.
        derivative: 0 for points, 1 or 2 for the derivatives of the curve by `t`.

    Returns:
        One row of weights a point; for points a row sums to 1.

    Raises:
        ValueError: If there are fewer than two control points.
    """
    if knots < 2:
        raise ValueError(f"a curve needs at least 2 control points, got {knots}.")
    position = t * (knots - 1)
    inside = jnp.clip(position, 0.0, knots - 1.0)
    first = jnp.clip(jnp.floor(inside), 0.0, knots - 2.0)
    f, beyond = inside - first, position - inside
    one, none = jnp.ones_like(f), jnp.zeros_like(f)
    within = jnp.where(beyond == 0.0, 2.0, 0.0)
    powers = (
        (one, f + beyond, f * (f + 2.0 * beyond), f * f * (f + 3.0 * beyond)),
        (none, one, 2.0 * f, 3.0 * f * f),
        (none, none, within, 3.0 * f * within),
    )[derivative]
    # A phantom's weight goes to the two points that it is made of.
    row = np.eye(knots, dtype=t.dtype)
    before, after = 2.0 * row[0] - row[1], 2.0 * row[-1] - row[-2]
    column = jnp.arange(-1, knots + 1, dtype=t.dtype)
    spread = jnp.asarray(np.stack([before, *row, after]))
    weights = jnp.zeros((t.shape[0], knots + 2), t.dtype)
    for tap, coefficients in enumerate(BASIS):
        terms = [c * p for c, p in zip(coefficients, powers, strict=True) if c]
        weight = functools.reduce(operator.add, terms) * (knots - 1.0) ** derivative
        here = column[None, :] == (first + (tap - 1.0))[:, None]
        weights += jnp.where(here, weight[:, None], 0.0)
    return jnp.matmul(weights, spread, precision=EXACT)


def catmull_rom(control: Float[Array, "knots axes"], t: ScalarLike) -> Array:
    """Return the point at `t` of the Catmull-Rom curve through `control`.

    Args:
        control: Control points; the curve passes point `k` at `t = k / (knots - 1)`.
        t: Where to evaluate, from 0 to 1; see `catmull_rom_weights`.
    """
    at = jnp.asarray(t, control.dtype)[None]
    weights = catmull_rom_weights(control.shape[0], at)
    return jnp.matmul(weights, control, precision=EXACT)[0]


def linear_weights(
    knots: int, t: Float[Array, " points"]
) -> Float[Array, "points knots"]:
    """Return the weights of linear interpolation between values at even knots."""
    position = jnp.clip(t, 0.0, 1.0) * (knots - 1)
    distance = jnp.abs(position[:, None] - jnp.arange(knots, dtype=t.dtype)[None, :])
    return jnp.maximum(1.0 - distance, 0.0)


def arc_length(points: Float[Array, "points 3"]) -> Float[Array, " points"]:
    """Return how far along the polyline each point lies, in metres, from 0."""
    steps = norm(points[1:] - points[:-1])
    return jnp.concatenate([jnp.zeros(1, points.dtype), jnp.cumsum(steps)])


def resample(points: Float[Array, "points 3"], count: int) -> Float[Array, "count 3"]:
    """Return `count` points at equal distances along a polyline, both ends included."""
    along = arc_length(points)
    at = jnp.linspace(0.0, 1.0, count, dtype=points.dtype) * along[-1]
    return jax.vmap(jnp.interp, (None, None, 1), 1)(at, along, points)
