"""Binding: the coordinates of points in a cluster, and clusters that follow another."""

import functools
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .closest import (
    PER_SEGMENT,
    Axis,
    Nearest,
    follow_samples,
    make_axis,
    nearest,
    place_near,
)
from .contour import contour_radius
from .curve import EXACT, catmull_rom_weights, linear_weights
from .cylinder import (
    GeneralizedCylinder,
    Sections,
    cylinder_frames,
    cylinder_point,
    knot_sections,
    sections_between,
)
from .frame import Frames
from .section import carry, plane_of, turns_along
from .vector import TINY, norm

# A scale below this counts as zero: what it has flattened does not come back.
FLAT = 1e-6
# Clusters whose whole skeletons are fitted at once.
BATCH = 64


class Bound(NamedTuple):
    r"""The coordinates of a point in a cluster, $(r, \theta, t) = V^{-1}(p)$.

    Attributes:
        r: Share of the contour's radius.
        theta: Angle about the tangent, from the normal, in radians.
        t: Where along the skeleton; outside [0, 1] on the lines along its end tangents.
        ambiguous: Whether the closest point of the skeleton is not unique, or the point
            is beyond the radius of curvature: `update_point` may miss it.
    """

    r: Float[Array, "*batch"]
    theta: Float[Array, "*batch"]
    t: Float[Array, "*batch"]
    ambiguous: Bool[Array, "*batch"]


class Binder(NamedTuple):
    """A cluster prepared to be bound to.

    Attributes:
        cylinder: The cluster.
        frames: Its frames at the knots.
        axis: Its skeleton, for the search.
    """

    cylinder: GeneralizedCylinder
    frames: Frames
    axis: Axis


class Followed(NamedTuple):
    """How a point of space follows a binder that has changed.

    Attributes:
        p: Where the point goes.
        moved: The linear map of its surroundings.
        turn: By how much the twist there has changed.
        tangent: The binder's tangent there after the change.
    """

    p: Float[Array, " 3"]
    moved: Float[Array, "3 3"]
    turn: Float[Array, ""]
    tangent: Float[Array, " 3"]


def make_binder(cylinder: GeneralizedCylinder) -> Binder:
    """Return one cluster prepared to be bound to."""
    frames = cylinder_frames(cylinder)
    return Binder(cylinder, frames, make_axis(cylinder.skeleton, frames.tangent))


def bind_point(cylinder: GeneralizedCylinder, p: Float[Array, " 3"]) -> Bound:
    r"""Return the coordinates of a point in a cluster: equation (4-4) inverted.

    The point $C(t)$ is the closest of the skeleton, as `closest.nearest` has it. With
    $P_N$ and $P_B$, the projections of $p - C(t)$ on $\bar N(t)$ and $\bar B(t)$,

    $$y = P_B / S_B, \quad x = (P_N - H y) / S_N, \quad
      \theta = \operatorname{atan2}(y, x) - W, \quad r = |(x, y)| / R(\theta, t).$$

    The thesis (4.6.1) has no shear, and takes the angle from (4-7), whose misprint
    `ownership.local_coordinates` describes. It corrects the angle for the scales but
    takes $r = |p - C(t)| / R(\theta, t)$, which is right only where both scales are 1:
    (4-4) scales what the radius is multiplied by, so the length of $(x, y)$ counts.

    What cannot be inverted is lost, with finite results: where a scale is below
    `FLAT`, the distance along its axis becomes 0; where the contour has no radius at
    the angle, $r = 0$.

    Args:
        cylinder: The cluster.
        p: The point, in metres.
    """
    binder = make_binder(cylinder)
    place = nearest(binder.axis, p)
    here = binder_sections(binder, place.t)
    across = jnp.matmul(plane_of(here.frames)[0].T, p - here.centre[0], precision=EXACT)
    x, y = jnp.matmul(inverse_shape(here), across, precision=EXACT)
    distance = norm(jnp.stack([x, y]))
    apart = distance > 0.0
    angle = jnp.arctan2(jnp.where(apart, y, 0.0), jnp.where(apart, x, 1.0))
    theta = angle - here.twist[0]
    radius = radius_at(cylinder, theta, place.t)
    some = jnp.abs(radius) > TINY
    r = jnp.where(some, distance / jnp.where(some, radius, 1.0), 0.0)
    return Bound(r, theta, place.t, place.ambiguous)


def update_point(cylinder: GeneralizedCylinder, bound: Bound) -> Float[Array, " 3"]:
    """Return the point that has given coordinates in a cluster: equation (4-4)."""
    return cylinder_point(cylinder, bound.r, bound.theta, bound.t)


@jax.jit
def bind_points(cylinder: GeneralizedCylinder, p: Float[Array, "points 3"]) -> Bound:
    """Return the coordinates of many points in one cluster; see `bind_point`."""
    return jax.vmap(bind_point, (None, 0))(cylinder, p)


@jax.jit
def update_points(
    cylinder: GeneralizedCylinder, bound: Bound
) -> Float[Array, "points 3"]:
    """Return the points that have given coordinates in one cluster."""
    return jax.vmap(update_point, (None, 0))(cylinder, bound)


def follow(
    before: GeneralizedCylinder,
    after: GeneralizedCylinder,
    bound: GeneralizedCylinder,
    *,
    whole_skeleton: bool = False,
    held: Bool[Array, "clusters knots"] | None = None,
) -> GeneralizedCylinder:
    r"""Return clusters that follow a binder which changes [Kim02, section 4.6.1].

    Control points are bound to the binder as it was and updated with it as it is. What
    is around them follows the same map to first order, so that the content of a
    cluster, clusters or strands, goes where it would go if it were bound itself: the
    cross-section at $C$ is mapped by $\bar F' A' A^{-1} \bar F^{-1}$, where the frame
    $\bar F = (\bar N, \bar B, \bar T)$ and $A$ holds the map of `section_maps`, the
    contour's radius and, along the tangent, the length of $C'(t)$.

    A point that its coordinates would miss (see `bind_point`) keeps its distance along
    the tangent. So a binder that does not change moves nothing, and one that moves
    rigidly takes everything along. A binder without radius is an axis: distances from
    it are kept.

    The closest points of successive knots may be far apart where the binder is bent
    more than its distance allows; then clusters drift [Singh 1998]. With
    `whole_skeleton` each skeleton is fitted to the binder's as a whole, as the thesis
    suggests: its knots never go back along the binder.

    Args:
        before: The binder as it was.
        after: The binder as it is.
        bound: The clusters that follow, stacked.
        whole_skeleton: Whether to fit whole skeletons, not each control point alone.
        held: Control points that stay where they are, as roots do; None for none.
    """
    if held is None:
        held = jnp.zeros(bound.twist.shape, bool)
    return follow_binder(before, after, bound, held, whole_skeleton)


@functools.partial(jax.jit, static_argnames="whole_skeleton")
def follow_binder(
    before: GeneralizedCylinder,
    after: GeneralizedCylinder,
    bound: GeneralizedCylinder,
    held: Bool[Array, "clusters knots"],
    whole_skeleton: bool,
) -> GeneralizedCylinder:
    """`follow`, compiled: its arguments with nothing left out."""
    binders = jax.vmap(make_binder)(
        jax.tree.map(lambda *x: jnp.stack(x), before, after)
    )
    was, now = (jax.tree.map(lambda leaf, i=i: leaf[i], binders) for i in range(2))

    def one(item):
        cylinder, held = item
        if whole_skeleton:
            samples = follow_samples(was.axis, cylinder.skeleton)
            place = jax.vmap(place_near, (None, 0, 0, None))(
                was.axis, cylinder.skeleton, samples, 1.0 / PER_SEGMENT
            )
        else:
            place = jax.vmap(nearest, (None, 0))(was.axis, cylinder.skeleton)
        return follow_cluster(was, now, cylinder, place, held)

    if whole_skeleton:
        return jax.lax.map(one, (bound, held), batch_size=BATCH)
    return jax.vmap(one)((bound, held))


def follow_cluster(
    before: Binder,
    after: Binder,
    bound: GeneralizedCylinder,
    place: Nearest,
    held: Bool[Array, " knots"],
) -> GeneralizedCylinder:
    """Return one cluster that follows a binder; see `follow`."""
    at = jax.vmap(follow_point, (None, None, 0, 0))(
        before, after, bound.skeleton, place.t
    )
    still = jnp.eye(3, dtype=at.p.dtype)[None]
    moved = jnp.where(held[:, None, None], still, at.moved)
    skeleton = jnp.where(held[:, None], bound.skeleton, at.p)
    turn = jnp.where(held, 0.0, at.turn)
    turns = turns_along(skeleton, at.tangent, turn)
    return carry(bound, skeleton, moved, turns)


def follow_point(
    before: Binder, after: Binder, p: Float[Array, " 3"], t: Float[Array, ""]
) -> Followed:
    """Return how a point at `t` of a binder follows it."""
    was, now = binder_sections(before, t), binder_sections(after, t)
    inverse = inverse_shape(was)
    axes = [jnp.stack(x.frames, axis=-1)[0] for x in (was, now)]  # T, N, B
    rest = p - was.centre[0]
    local = jnp.matmul(axes[0].T, rest, precision=EXACT)
    x, y = jnp.matmul(inverse, local[1:], precision=EXACT)
    apart = x * x + y * y > TINY**2
    angle = jnp.arctan2(jnp.where(apart, y, 0.0), jnp.where(apart, x, 1.0))
    theta = angle - was.twist[0]
    radius = radius_at(before.cylinder, theta, t), radius_at(after.cylinder, theta, t)
    wide = ratio(radius[1], radius[0])
    turn = now.twist[0] - was.twist[0]
    across = jnp.matmul(turned(turn), inverse, precision=EXACT)
    across = wide * jnp.matmul(shape(now), across, precision=EXACT)
    along = ratio(speed_at(after, t), speed_at(before, t))
    inner = jnp.zeros((3, 3), p.dtype).at[0, 0].set(along).at[1:, 1:].set(across)
    moved = jnp.matmul(axes[1], inner, precision=EXACT)
    moved = jnp.matmul(moved, axes[0].T, precision=EXACT)
    p = now.centre[0] + jnp.matmul(moved, rest, precision=EXACT)
    return Followed(p, moved, turn, now.frames.tangent[0])


def binder_sections(binder: Binder, t: Float[Array, ""]) -> Sections:
    """Return the one cross-section of a binder at `t`, cut at the angle 0."""
    sections = knot_sections(binder.cylinder, binder.frames, 0.0)
    return sections_between(sections, t[None])


def radius_at(
    cylinder: GeneralizedCylinder, theta: Float[Array, ""], t: Float[Array, ""]
) -> Float[Array, ""]:
    r"""Return the contour's radius $R(\theta, t)$."""
    weights = linear_weights(cylinder.radius.shape[0], t[None])[0]
    offset = jnp.matmul(weights, cylinder.offset, precision=EXACT)
    return contour_radius(jnp.dot(weights, cylinder.radius), offset, theta)


def speed_at(binder: Binder, t: Float[Array, ""]) -> Float[Array, ""]:
    """Return the length of the skeleton's derivative by `t`."""
    skeleton = binder.cylinder.skeleton
    weights = catmull_rom_weights(skeleton.shape[0], jnp.clip(t, 0.0, 1.0)[None], 1)
    return norm(jnp.matmul(weights, skeleton, precision=EXACT))[0]


def shape(here: Sections) -> Float[Array, "2 2"]:
    """Return scales and shear of one cross-section as a matrix."""
    (scale_n, scale_b), shear = here.scale[0], here.shear[0]
    return jnp.stack(
        [jnp.stack([scale_n, shear]), jnp.stack([jnp.zeros_like(shear), scale_b])]
    )


def inverse_shape(here: Sections) -> Float[Array, "2 2"]:
    """Return the inverse of `shape`, zero along axes that it flattens."""
    (scale_n, scale_b), shear = here.scale[0], here.shear[0]
    over_n = ratio(jnp.ones_like(shear), scale_n, FLAT, 0.0)
    over_b = ratio(jnp.ones_like(shear), scale_b, FLAT, 0.0)
    return jnp.stack(
        [
            jnp.stack([over_n, -shear * over_n * over_b]),
            jnp.stack([jnp.zeros_like(shear), over_b]),
        ]
    )


def turned(angle: Float[Array, ""]) -> Float[Array, "2 2"]:
    """Return the rotation of the plane by an angle."""
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    return jnp.stack([jnp.stack([cos, -sin]), jnp.stack([sin, cos])])


def ratio(
    above: Float[Array, ""],
    below: Float[Array, ""],
    least: float = TINY,
    otherwise: float = 1.0,
) -> Float[Array, ""]:
    """Return a quotient, or `otherwise` where the divisor is less than `least`."""
    some = jnp.abs(below) > least
    return jnp.where(some, above / jnp.where(some, below, 1.0), otherwise)
