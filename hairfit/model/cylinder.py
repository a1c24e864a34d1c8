"""Generalized cylinders: contours swept along the skeleton of a hair cluster."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, ScalarLike

from ..host import more_rows, on_device
from .contour import contour_radius
from .curve import EXACT, catmull_rom_weights, linear_weights
from .frame import Frames, rotation_minimising_frames
from .vector import perpendicular, reject, unit

TOGETHER = 64  # clusters: programs are compiled for multiples of so many


class GeneralizedCylinder(eqx.Module):
    r"""One hair cluster, from scalp to tip [Kim02, section 4.2]. Metres, radians.

    A point is $V(r, \theta, t) = C(t) + (S_N x + H y) \bar N(t) + S_B y \bar B(t)$
    with $x = r R(\theta, t) \cos(\theta + W)$, $y = r R(\theta, t) \sin(\theta + W)$.
    With $H = 0$ this is equation (4-4). The shear $H$ completes scale and twist to any
    linear map of the cross-section, which artists' grooms need.

    Many clusters are one module whose arrays have a leading axis. `stack` and
    `jax.vmap(GeneralizedCylinder)` make one; calling the class directly is for one
    cluster.

    Attributes:
        skeleton: Control points of the Catmull-Rom curve $C$, at $t = k / (knots - 1)$.
        normal: Direction of $\theta = 0$ at the root; it is made perpendicular to the
            tangent.
        radius: Global radius of the contour at each knot.
        offset: Offsets of the contour from `radius`, at 32 even angles from 0.
        scale: $S_N$ and $S_B$.
        twist: $W$.
        shear: $H$.
    """

    skeleton: Float[Array, "knots 3"]
    normal: Float[Array, " 3"]
    radius: Float[Array, " knots"]
    offset: Float[Array, "knots 32"]
    scale: Float[Array, "knots 2"]
    twist: Float[Array, " knots"]
    shear: Float[Array, " knots"]


class Sections(NamedTuple):
    """Cross-sections of one cluster, cut at one angle of the contour.

    Attributes:
        centre: Points of the skeleton.
        frames: Reference frames.
        radius: Radius of the contours at the angle.
        scale: $S_N$ and $S_B$.
        twist: $W$.
        shear: $H$.
    """

    centre: Float[Array, "knots 3"]
    frames: Frames
    radius: Float[Array, " knots"]
    scale: Float[Array, "knots 2"]
    twist: Float[Array, " knots"]
    shear: Float[Array, " knots"]


def cylinder_frames(cylinder: GeneralizedCylinder) -> Frames:
    """Return the rotation-minimising frames at the knots of one cluster."""
    return rotation_minimising_frames(cylinder.skeleton, cylinder.normal)


def together(count: int) -> int:
    """Return a number of clusters, rounded up: what is compiled for it serves more."""
    return -(-count // TOGETHER) * TOGETHER


def frames_of(cylinder: GeneralizedCylinder) -> Frames:
    """Return the frames at the knots of stacked clusters.

    Clusters are filled up to a common number, so that trees of about as many share a
    compiled program. Runs outside `jit`.
    """
    count = len(cylinder.skeleton)
    found = _stacked_frames(
        on_device(more_rows(cylinder.skeleton, together(count))),
        on_device(more_rows(cylinder.normal, together(count))),
    )
    return Frames(*(on_device(np.asarray(leaf)[:count]) for leaf in found))


_stacked_frames = jax.jit(jax.vmap(rotation_minimising_frames))


def knot_sections(
    cylinder: GeneralizedCylinder, frames: Frames, theta: ScalarLike
) -> Sections:
    """Return the cross-sections at the knots, cut at the angle `theta`."""
    radius = jax.vmap(contour_radius, (0, 0, None))(
        cylinder.radius, cylinder.offset, theta
    )
    scale, twist, shear = cylinder.scale, cylinder.twist, cylinder.shear
    return Sections(cylinder.skeleton, frames, radius, scale, twist, shear)


def sections_between(sections: Sections, t: Float[Array, " points"]) -> Sections:
    """Return the cross-sections at `t`, from those at the knots.

    The skeleton is the Catmull-Rom curve; everything else is interpolated linearly, as
    in the thesis. The frames are made orthonormal again, or a cluster would grow thin
    where it bends between two knots.
    """
    knots = sections.centre.shape[0]
    curve, line = catmull_rom_weights(knots, t), linear_weights(knots, t)

    def between(values):
        return jnp.matmul(line, values, precision=EXACT)

    def square_up(tangent, normal):
        tangent = unit(tangent, perpendicular(normal))
        normal = reject(normal, tangent)
        return Frames(tangent, normal, jnp.cross(tangent, normal))

    tangent, normal, _ = sections.frames
    return Sections(
        centre=jnp.matmul(curve, sections.centre, precision=EXACT),
        frames=jax.vmap(square_up)(between(tangent), between(normal)),
        radius=between(sections.radius),
        scale=between(sections.scale),
        twist=between(sections.twist),
        shear=between(sections.shear),
    )


def section_points(
    sections: Sections, r: ScalarLike, theta: ScalarLike
) -> Float[Array, "knots 3"]:
    """Return the point of each cross-section at `(r, theta)`, by equation (4-4)."""
    x = r * sections.radius * jnp.cos(theta + sections.twist)
    y = r * sections.radius * jnp.sin(theta + sections.twist)
    along_normal = sections.scale[:, 0] * x + sections.shear * y
    along_binormal = sections.scale[:, 1] * y
    return (
        sections.centre
        + along_normal[:, None] * sections.frames.normal
        + along_binormal[:, None] * sections.frames.binormal
    )


def cylinder_knots(
    cylinder: GeneralizedCylinder, r: ScalarLike, theta: ScalarLike
) -> Float[Array, "knots 3"]:
    """Return the points at `(r, theta)` at the knots of one cluster, in metres.

    Args:
        cylinder: One cluster.
        r: Share of the contour's radius; 1 on the contour.
        theta: Angle about the tangent, from the normal, in radians.
    """
    sections = knot_sections(cylinder, cylinder_frames(cylinder), theta)
    return section_points(sections, r, theta)


def cylinder_point(
    cylinder: GeneralizedCylinder, r: ScalarLike, theta: ScalarLike, t: ScalarLike
) -> Float[Array, " 3"]:
    """Return one point of a cluster by equation (4-4), in metres.

    Args:
        cylinder: One cluster.
        r: Share of the contour's radius; 1 on the contour.
        theta: Angle about the tangent, from the normal, in radians.
        t: Where along the skeleton, from 0 (root) to 1 (tip).
    """
    sections = knot_sections(cylinder, cylinder_frames(cylinder), theta)
    at = jnp.asarray(t, cylinder.skeleton.dtype)[None]
    return section_points(sections_between(sections, at), r, theta)[0]
