"""Cross-sections of clusters as linear maps, and how they are carried elsewhere."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .curve import EXACT
from .cylinder import GeneralizedCylinder
from .frame import Frames, rotation_minimising_frames, tangents
from .vector import TINY, perpendicular, unit

# Below this share of 4 vectors count as opposite.
OPPOSITE = 1e-8


def section_maps(cylinder: GeneralizedCylinder) -> Float[Array, "knots 2 2"]:
    r"""Return the linear maps of one cluster's cross-sections, one a knot.

    Equation (4-4) sends the contour's plane to the plane of $\bar N$ and $\bar B$ by

    $$M = \begin{pmatrix} S_N & H \\ 0 & S_B \end{pmatrix}
          \begin{pmatrix} \cos W & -\sin W \\ \sin W & \cos W \end{pmatrix}:$$

    a point is $C + (\bar N, \bar B) \, M \, r R(\theta) (\cos\theta, \sin\theta)^T$.
    """
    cos, sin = jnp.cos(cylinder.twist), jnp.sin(cylinder.twist)
    scale_n, scale_b = cylinder.scale[:, 0], cylinder.scale[:, 1]
    above = jnp.stack(
        [scale_n * cos + cylinder.shear * sin, cylinder.shear * cos - scale_n * sin],
        axis=1,
    )
    below = jnp.stack([scale_b * sin, scale_b * cos], axis=1)
    return jnp.stack([above, below], axis=1)


def with_section_maps(
    cylinder: GeneralizedCylinder, maps: Float[Array, "knots 2 2"]
) -> GeneralizedCylinder:
    r"""Return one cluster whose cross-sections have given maps.

    The inverse of `section_maps`. A map has many decompositions: turns may be added to
    the twist, and half a turn with the signs of both scales. At the root the sign of
    $S_B$ is kept; from there the twist's difference from the twist that the cluster had
    is taken continuous, a scale may change its sign. So `with_section_maps(cylinder,
    section_maps(cylinder))` is the cluster itself, however often it winds, and a
    cluster without twist gets one that is continuous along the knots.

    Where the second row of a map vanishes ($S_B = 0$), the twist stays.

    Args:
        cylinder: One cluster; its skeleton and contours stay.
        maps: The maps, in the frames that the cluster has.
    """
    own = cylinder.twist
    cos, sin = jnp.cos(own), jnp.sin(own)
    across, along = maps[:, 1, 0], maps[:, 1, 1]
    turned = across * cos - along * sin
    kept = across * sin + along * cos
    some = turned * turned + kept * kept > TINY**2
    sign = jnp.where(cylinder.scale[:, 1] < 0.0, -1.0, 1.0).astype(own.dtype)
    angle = jnp.arctan2(
        jnp.where(some, sign * turned, 0.0), jnp.where(some, sign * kept, 1.0)
    )
    twist = own + jnp.unwrap(angle, period=jnp.pi)
    cos, sin = jnp.cos(twist), jnp.sin(twist)
    scale_n = maps[:, 0, 0] * cos - maps[:, 0, 1] * sin
    scale_b = maps[:, 1, 0] * sin + maps[:, 1, 1] * cos
    shear = maps[:, 0, 0] * sin + maps[:, 0, 1] * cos
    return eqx.tree_at(
        lambda c: (c.scale, c.twist, c.shear),
        cylinder,
        (jnp.stack([scale_n, scale_b], axis=1), twist, shear),
    )


def plane_of(frames: Frames) -> Float[Array, "*batch knots 3 2"]:
    """Return the matrices whose columns are normal and binormal."""
    return jnp.stack([frames.normal, frames.binormal], axis=-1)


def carry(
    cylinder: GeneralizedCylinder,
    skeleton: Float[Array, "knots 3"],
    moved: Float[Array, "knots 3 3"],
    turn: Float[Array, " knots"] | None = None,
) -> GeneralizedCylinder:
    """Return one cluster on another skeleton, with its content moved along.

    A point of the cross-section at a knot, seen from the skeleton, is mapped by
    `moved` and then projected along the new skeleton's tangent. Scale, twist and shear
    become what that needs.

    Args:
        cylinder: One cluster.
        skeleton: The new skeleton.
        moved: The linear map in space of each cross-section.
        turn: By how much the content is turned about the tangent, about, in radians:
            it tells by how many turns, which the maps leave open. None for less than
            a quarter turn from knot to knot.
    """
    normal = jnp.matmul(moved[0], cylinder.normal, precision=EXACT)
    frames = jax.vmap(rotation_minimising_frames)(
        jnp.stack([cylinder.skeleton, skeleton]), jnp.stack([cylinder.normal, normal])
    )
    before, after = plane_of(frames)
    twist = cylinder.twist if turn is None else cylinder.twist + turn
    there = eqx.tree_at(
        lambda c: (c.skeleton, c.normal, c.twist), cylinder, (skeleton, normal, twist)
    )
    maps = jnp.swapaxes(after, 1, 2)
    for factor in (moved, before, section_maps(cylinder)):
        maps = jnp.matmul(maps, factor, precision=EXACT)
    return with_section_maps(there, maps)


def turns_along(
    skeleton: Float[Array, "knots 3"],
    axis: Float[Array, "knots 3"],
    angle: Float[Array, " knots"],
) -> Float[Array, " knots"]:
    """Return by how much content turns about its skeleton, as `carry` takes it.

    Of a turn about an axis only what is about the skeleton's tangent counts, summed up
    from the root.

    Args:
        skeleton: The skeleton.
        axis: The axis of the turn at each knot.
        angle: The angle of the turn at each knot, in radians.
    """
    chord = unit(skeleton[1:] - skeleton[:-1], jnp.zeros_like(skeleton[1:]))
    share = 0.5 * jnp.sum(chord * (axis[1:] + axis[:-1]), axis=1)
    steps = share * (angle[1:] - angle[:-1])
    turns = jnp.concatenate([jnp.zeros(1, angle.dtype), jnp.cumsum(steps)])
    return jax.lax.stop_gradient(turns)


def on_skeleton(
    cylinder: GeneralizedCylinder, skeleton: Float[Array, "knots 3"]
) -> GeneralizedCylinder:
    """Return one cluster on another skeleton, each cross-section turned the least.

    A cross-section is turned with the tangent at its knot and not about it. So it stays
    as it is where the skeleton does, and the cluster keeps its thickness.
    """
    before, after = jax.vmap(tangents)(jnp.stack([cylinder.skeleton, skeleton]))
    return carry(cylinder, skeleton, jax.vmap(least_rotation)(before, after))


def least_rotation(
    start: Float[Array, " 3"], end: Float[Array, " 3"]
) -> Float[Array, "3 3"]:
    r"""Return the rotation that takes one unit vector to another by the shortest way.

    Rodrigues' formula without angles: with $v = a \times b$ and $c = a \cdot b$ it is
    $1 + [v] + [v]^2 / (1 + c)$. For opposite vectors, which have no shortest way, it is
    half a turn about some perpendicular.
    """
    skew = cross_matrix(jnp.cross(start, end))
    both = jnp.matmul(skew, skew, precision=EXACT)
    square = jnp.sum((start + end) ** 2)  # twice 1 + c
    apart = square > OPPOSITE
    share = jnp.where(apart, 2.0 / jnp.where(apart, square, 1.0), 0.0)
    eye = jnp.eye(3, dtype=start.dtype)
    side = perpendicular(start)
    half_turn = 2.0 * jnp.outer(side, side) - eye
    return jnp.where(apart, eye + skew + share * both, half_turn)


def cross_matrix(v: Float[Array, " 3"]) -> Float[Array, "3 3"]:
    r"""Return the matrix $[v]$ of the cross product, $[v] w = v \times w$."""
    return jnp.cross(v[None], jnp.eye(3, dtype=v.dtype)).T


def rotation(axis: Float[Array, " 3"], angle: Float[Array, ""]) -> Float[Array, "3 3"]:
    """Return the rotation about a unit vector by an angle in radians."""
    skew = cross_matrix(axis)
    both = jnp.matmul(skew, skew, precision=EXACT)
    eye = jnp.eye(3, dtype=axis.dtype)
    return eye + jnp.sin(angle) * skew + (1.0 - jnp.cos(angle)) * both
