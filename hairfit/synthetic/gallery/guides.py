"""Guides of the gallery: hair swept along the head, and lines on the scalp."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...model import Scalp
from ...model.maps import ScalpMaps, even_maps
from ...model.scalp import points_on, scalp_uv
from ...render.raster import unit
from ..guides import DOWN, keep_off, resampled
from ..head import CRANIUM, head_normal
from .base import Guides, ramp

STEPS = 48
# Texels a side of painted maps.
TEXELS = 25

Points = Float[np.ndarray, "points 3"]


class Sweep(NamedTuple):
    """How hair is swept.

    Attributes:
        rise: How steeply it leaves the scalp: the slope against the way it is combed.
        hold: Length over which it keeps its way before it falls, in metres.
        off: How far off the head it lies at least, in metres.
    """

    rise: float
    hold: float
    off: float | Float[np.ndarray, " clusters"]


def swept_guides(
    roots: Points,
    knots: int,
    way: Points,
    length: float | Float[np.ndarray, " clusters"],
    how: Sweep,
) -> Guides:
    """Return curves that leave their roots along a way, and fall as they grow.

    Args:
        roots: Where they start, on the head.
        knots: Points of each.
        way: Where each is combed to, in the world.
        length: Of each, in metres.
        how: How it is swept.
    """
    normal = head_normal(roots)
    flat = way - np.einsum("ij,ij->i", way, normal)[:, None] * normal
    length = np.broadcast_to(length, len(roots))[:, None]
    off = np.broadcast_to(how.off, len(roots))[:, None]
    heading = unit(how.rise * normal + unit(flat + 1e-9))
    step, path = length / STEPS, [roots]
    for number in range(1, STEPS + 1):
        along = number * step
        held = np.exp(-along / how.hold)
        target = held * unit(flat + 1e-9) + (1.0 - held) * DOWN
        heading = unit(heading + 75.0 * step * target)
        moved = keep_off(path[-1] + step * heading, off * ramp(along / 0.03, 0.0, 1.0))
        heading = unit(moved - path[-1])
        path.append(path[-1] + step * heading)
    return resampled(list(np.stack(path, 1)), knots)


def straight_guides(roots: Points, knots: int, tips: Points) -> Guides:
    """Return straight lines from roots to tips."""
    share = np.linspace(0.0, 1.0, knots)[None, :, None]
    return roots[:, None] + share * (tips - roots)[:, None]


def scalp_line(scalp: Scalp, points: Points) -> Float[np.ndarray, "points 2"]:
    """Return the line on the scalp, in (u, v), that is closest to points."""
    dtype = scalp.control.dtype
    return np.asarray(uv_of(scalp, jnp.asarray(points, dtype)))


@jax.jit
def uv_of(scalp: Scalp, p: Float[Array, "points 3"]) -> Float[Array, "points 2"]:
    """Return (u, v) of the scalp's points closest to points."""
    return jax.vmap(scalp_uv, (None, 0))(scalp, p)


def length_line(x: float, front: float = 70.0, back: float = 125.0) -> Points:
    """Return points over the head in a plane of constant x, from front to back.

    Args:
        x: The plane; positive is the person's left.
        front: Where it starts: angle from straight up, in degrees.
        back: Where it ends.
    """
    angle = np.radians(np.linspace(-front, back, 25))
    arc = np.stack([np.zeros(25), np.cos(angle), -np.sin(angle)], 1)
    return keep_off(CRANIUM + 0.09 * arc + [x, 0.0, 0.0], np.zeros((25, 1)))


def paint_maps(
    scalp: Scalp,
    length: Callable[[Points], Float[np.ndarray, " points"]] | None = None,
    density: Callable[[Points], Float[np.ndarray, " points"]] | None = None,
    curl: float = 0.0,
) -> ScalpMaps:
    """Return maps painted by what holds at the scalp's points in the world.

    Args:
        scalp: The scalp.
        length: Share of the length at points; None for 1.
        density: Share of the roots that grow; None for 1.
        curl: Radius of single hairs' curls, in metres.
    """
    maps = even_maps(TEXELS, TEXELS, curl=curl)
    side = np.linspace(0.0, 1.0, TEXELS)
    uv = np.stack(np.meshgrid(side, side, indexing="ij"), -1).reshape(-1, 2)
    p = np.asarray(points_on(scalp, jnp.asarray(uv, scalp.control.dtype)))

    def painted(values, paint):
        if paint is None:
            return values
        return jnp.asarray(paint(p).reshape(values.shape), values.dtype)

    return ScalpMaps(
        painted(maps.density, density),
        painted(maps.length, length),
        maps.thickness,
        maps.colour,
        maps.curl,
    )
