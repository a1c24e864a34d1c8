"""Reference frames along a skeleton."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .vector import TINY, perpendicular, reject, unit


class Frames(NamedTuple):
    """Right-handed orthonormal frames at the knots: binormal = tangent x normal."""

    tangent: Float[Array, "knots 3"]
    normal: Float[Array, "knots 3"]
    binormal: Float[Array, "knots 3"]


def tangents(skeleton: Float[Array, "knots 3"]) -> Float[Array, "knots 3"]:
    """Return the unit tangents of the Catmull-Rom curve at its knots.

    Where the curve stands still (a cusp, or knots that coincide), the tangent of the
    knot before holds; a skeleton that begins so starts along y.
    """
    velocity = jnp.concatenate(
        [
            skeleton[1:2] - skeleton[:1],
            0.5 * (skeleton[2:] - skeleton[:-2]),
            skeleton[-1:] - skeleton[-2:-1],
        ]
    )
    moves = jnp.sum(velocity**2, axis=1) > TINY**2
    last = jax.lax.cummax(jnp.where(moves, jnp.arange(len(velocity)), -1))
    up = jnp.array([0.0, 1.0, 0.0], skeleton.dtype)
    tangent = unit(velocity, jnp.broadcast_to(up, velocity.shape))
    return jnp.where(last[:, None] < 0, up, tangent[last])


def rotation_minimising_frames(
    skeleton: Float[Array, "knots 3"], normal0: Float[Array, " 3"]
) -> Frames:
    """Return frames that do not turn about the skeleton, by double reflection.

    Each frame is carried to the next knot by two reflections, of fourth order in the
    step [Wang, Jüttler, Zheng and Liu 2008, Computation of rotation minimizing frames].

    Args:
        skeleton: Control points of the skeleton.
        normal0: Direction of the first normal (where the first contour has its zero
            angle); made perpendicular to the first tangent. If it is parallel to it,
            any perpendicular is taken.
    """
    tangent = tangents(skeleton)
    before, after = tangent[:-1], tangent[1:]
    # Knots that coincide: reflecting along the tangent leaves the least rotation.
    mirror = unit(skeleton[1:] - skeleton[:-1], before)
    turned = reflected(before, mirror)
    second = unit(after - turned, jnp.zeros_like(turned))

    def step(normal, mirrors):
        normal = reflected(reflected(normal, mirrors[0]), mirrors[1])
        return normal, normal

    first = reject(normal0, tangent[0])
    rest = jax.lax.scan(step, first, (mirror, second))[1]
    # Rounding adds up along the skeleton; the frames are orthonormal so.
    rest = rest - jnp.sum(rest * after, axis=1, keepdims=True) * after
    rest = unit(rest, jax.vmap(perpendicular)(after))
    normal = jnp.concatenate([first[None], rest])
    return Frames(tangent, normal, jnp.cross(tangent, normal))


def reflected(
    v: Float[Array, "*batch 3"], mirror: Float[Array, "*batch 3"]
) -> Float[Array, "*batch 3"]:
    """Return vectors reflected in planes with given unit normals; 0 leaves them."""
    return v - 2.0 * jnp.sum(mirror * v, axis=-1, keepdims=True) * mirror


def frenet_frames(skeleton: Float[Array, "knots 3"]) -> Frames:
    """Return the Frenet frames at the knots, for comparison.

    The normal points to the centre of curvature, so the frame flips at an inflection
    and is undefined on a straight stretch: there any perpendicular is taken.

    Args:
        skeleton: Control points of the skeleton, 3 or more.

    Raises:
        ValueError: If there are fewer than three knots.
    """
    if skeleton.shape[0] < 3:
        raise ValueError(
            f"Frenet frames need at least 3 knots, got {skeleton.shape[0]}."
        )
    tangent = tangents(skeleton)
    inner = skeleton[2:] - 2.0 * skeleton[1:-1] + skeleton[:-2]
    curvature = jnp.concatenate([inner[:1], inner, inner[-1:]])
    normal = jax.vmap(reject)(curvature, tangent)
    return Frames(tangent, normal, jnp.cross(tangent, normal))
