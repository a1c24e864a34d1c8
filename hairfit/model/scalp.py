"""The scalp: a tensor-product Catmull-Rom patch wrapped over the head."""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray, UInt32

from .curve import EXACT, catmull_rom_weights
from .vector import norm, unit

SIDE = 13
# Cells a side for the area of the patch, and for a first guess of the closest point.
AREA_CELLS = 144
GUESS_CELLS = 36
NEWTON_STEPS = 8
# So many roots are drawn at once, or a multiple: each number is compiled.
ROOTS_TOGETHER = 32_768


class Scalp(eqx.Module):
    """The region of a head where hair grows [Kim02, section 4.3]. Metres.

    Attributes:
        control: Control points; the patch runs through all of them, `control[i, j]` at
            `u = i / 12`, `v = j / 12`.
    """

    control: Float[Array, "13 13 3"]


class Tangents(NamedTuple):
    """How the scalp's point moves with u and with v, in metres."""

    u: Float[Array, " 3"]
    v: Float[Array, " 3"]


def scalp_point(scalp: Scalp, uv: Float[Array, " 2"]) -> Float[Array, " 3"]:
    """Return the scalp's point S(u, v), in metres.

    Args:
        scalp: The patch.
        uv: Where on the patch; outside [0, 1] it goes on along its end tangents.
    """
    return tensor_product(scalp, uv, 0, 0)


def scalp_tangents(scalp: Scalp, uv: Float[Array, " 2"]) -> Tangents:
    """Return the derivatives of S(u, v)."""
    return Tangents(tensor_product(scalp, uv, 1, 0), tensor_product(scalp, uv, 0, 1))


def tensor_product(
    scalp: Scalp, uv: Float[Array, " 2"], order_u: int, order_v: int
) -> Float[Array, " 3"]:
    """Return the scalp's point, or its derivative of the given orders by u and v."""
    along_u = catmull_rom_weights(SIDE, uv[:1], order_u)[0]
    along_v = catmull_rom_weights(SIDE, uv[1:], order_v)[0]
    rows = jnp.einsum("i,ijk->jk", along_u, scalp.control, precision=EXACT)
    return jnp.matmul(along_v, rows, precision=EXACT)


def scalp_normal(scalp: Scalp, uv: Float[Array, " 2"]) -> Float[Array, " 3"]:
    r"""Return the outward unit normal of the scalp.

    Outward is away from the patch's centroid, which lies under the dome of a scalp:
    the sign of $S_u \times S_v$ is the one that makes it, summed over all the patch
    with its area, point away from there. So the normal never flips within a patch,
    however it is bent locally or whichever way u and v run. A flat patch has no
    inside; its normal is $S_u \times S_v$.
    """
    du, dv = scalp_tangents(scalp, uv)
    outward = unit(
        scalp_point(scalp, uv) - jnp.mean(scalp.control, axis=(0, 1)),
        jnp.array([0.0, 1.0, 0.0], uv.dtype),
    )
    return unit(scalp_sign(scalp) * jnp.cross(du, dv), outward)


def scalp_sign(scalp: Scalp) -> Float[Array, ""]:
    r"""Return 1 where $S_u \times S_v$ points outwards, -1 where it points inwards."""
    p = jax.lax.stop_gradient(scalp.control)
    area = jnp.cross(
        p[1:, 1:] - p[:-1, :-1],  # the diagonals of each cell
        p[:-1, 1:] - p[1:, :-1],
    )
    cell = 0.25 * (p[1:, 1:] + p[:-1, :-1] + p[:-1, 1:] + p[1:, :-1])
    away = cell - jnp.mean(p, axis=(0, 1), keepdims=True)
    flux = jnp.sum(area * away)
    # Rounding alone gives a flat patch a side; it shall not.
    scale = jnp.sum(norm(area) * norm(away))
    return jnp.where(flux < -1e-6 * scale, -1.0, 1.0).astype(p.dtype)


points_on = jax.jit(jax.vmap(scalp_point, (None, 0)))
"""Points of the scalp at many places, `(places, 2)` to `(places, 3)`."""

normals_on = jax.jit(jax.vmap(scalp_normal, (None, 0)))
"""Normals of the scalp at many places, `(places, 2)` to `(places, 3)`."""


def sample_roots(
    scalp: Scalp, count: int, key: PRNGKeyArray | UInt32[Array, " 2"]
) -> Float[Array, "count 2"]:
    """Return `count` random roots (u, v), spread evenly over the scalp's area.

    The thesis samples evenly in (u, v), which crowds hair where the patch is narrow:
    towards its corners, or wherever a user placed control points close together. Real
    hair has its density per square centimetre, so roots are even in metres here.

    Args:
        scalp: The patch.
        count: Number of roots.
        key: Randomness.
    """
    more = -(-count // ROOTS_TOGETHER) * ROOTS_TOGETHER
    return roots_in(area_up_to(scalp), more, key)[:count]


@jax.jit
def area_up_to(scalp: Scalp) -> Float[Array, " cells"]:
    """Return the area of the patch up to and with each of its cells, row by row."""
    corner = jnp.linspace(0.0, 1.0, AREA_CELLS + 1, dtype=scalp.control.dtype)
    weights = catmull_rom_weights(SIDE, corner)
    p = jnp.einsum("ai,bj,ijk->abk", weights, weights, scalp.control, precision=EXACT)
    area = norm(jnp.cross(p[1:, 1:] - p[:-1, :-1], p[:-1, 1:] - p[1:, :-1]))
    return jnp.cumsum(area.reshape(-1))


@functools.partial(jax.jit, static_argnames="count")
def roots_in(
    total: Float[Array, " cells"], count: int, key: PRNGKeyArray | UInt32[Array, " 2"]
) -> Float[Array, "count 2"]:
    """Return random roots, as many in each cell as its share of the area asks for."""
    cell_key, place_key = jax.random.split(key)
    share = jax.random.uniform(cell_key, (count,), total.dtype)
    cell = jnp.searchsorted(total, share * total[-1], side="right")
    cell = jnp.minimum(cell, AREA_CELLS**2 - 1)
    place = jax.random.uniform(place_key, (count, 2), total.dtype)
    index = jnp.stack([cell // AREA_CELLS, cell % AREA_CELLS], axis=1)
    return (index.astype(total.dtype) + place) / AREA_CELLS


def scalp_uv(
    scalp: Scalp, p: Float[Array, " 3"], guess: Float[Array, " 2"] | None = None
) -> Float[Array, " 2"]:
    """Return (u, v) in [0, 1] of the scalp's point that is closest to `p`.

    Newton's method, from the closest point of a coarse grid or from `guess`, with
    u and v held where they reach the border. A step that does not come closer is
    shortened or left out, so the result is never further than the start.

    Args:
        scalp: The patch.
        p: A point, in metres.
        guess: Where to start; near it the closest point is searched.
    """
    start = closest_of_grid(scalp, p) if guess is None else guess

    def step(uv, _):
        return closer(scalp, p, uv), None

    start = jnp.clip(start, 0.0, 1.0)
    return jax.lax.scan(step, start, None, length=NEWTON_STEPS)[0]


def closer(
    scalp: Scalp, p: Float[Array, " 3"], uv: Float[Array, " 2"]
) -> Float[Array, " 2"]:
    """Return `uv` after one Newton step towards the point closest to `p`."""

    def distance(uv):
        rest = scalp_point(scalp, uv) - p
        return jnp.sum(rest * rest)

    rest = scalp_point(scalp, uv) - p
    du, dv = scalp_tangents(scalp, uv)
    slope = jnp.stack([jnp.dot(rest, du), jnp.dot(rest, dv)])
    flat = jnp.stack([jnp.dot(du, du), jnp.dot(du, dv), jnp.dot(dv, dv)])
    bend = [tensor_product(scalp, uv, *order) for order in ((2, 0), (1, 1), (0, 2))]
    curved = flat + jnp.stack([jnp.dot(rest, x) for x in bend])
    # Far off the surface, or near a knot, the curvature may mislead: leave it out.
    det_flat = flat[0] * flat[2] - flat[1] ** 2
    det_round = curved[0] * curved[2] - curved[1] ** 2
    trusted = (det_round > 0.1 * det_flat) & (curved[0] > 0.0)
    a, c, b = jnp.where(trusted, curved, flat)
    held = ((uv <= 0.0) & (slope > 0.0)) | ((uv >= 1.0) & (slope < 0.0))
    slope = jnp.where(held, 0.0, slope)
    c = jnp.where(jnp.any(held), 0.0, c)
    det = a * b - c * c
    move = jnp.stack([c * slope[1] - b * slope[0], c * slope[0] - a * slope[1]])
    move = move / jnp.where(det > 0.0, det, 1.0)
    shares = jnp.array([0.0, 1.0, 0.5, 0.125], uv.dtype)
    tries = jnp.clip(uv[None] + shares[:, None] * move[None], 0.0, 1.0)
    return tries[jnp.argmin(jax.vmap(distance)(tries))]


def closest_of_grid(scalp: Scalp, p: Float[Array, " 3"]) -> Float[Array, " 2"]:
    """Return (u, v) of the point of a coarse grid on the scalp closest to `p`."""
    side = jnp.linspace(0.0, 1.0, GUESS_CELLS + 1, dtype=p.dtype)
    weights = catmull_rom_weights(SIDE, side)
    grid = jnp.einsum(
        "ai,bj,ijk->abk", weights, weights, scalp.control, precision=EXACT
    ).reshape(-1, 3)
    rest = grid - p[None]
    closest = jnp.argmin(jnp.sum(rest * rest, axis=-1))
    return jnp.stack([side[closest // side.size], side[closest % side.size]])
