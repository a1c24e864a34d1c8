"""What a comb does to clusters: they turn and bend, and keep their length."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .cylinder import GeneralizedCylinder
from .edit import WHOLE, Grip, edit_each
from .reshape import Indices, chain, place_on
from .tree import HairTree
from .vector import norm, unit


class OnPolyline(NamedTuple):
    """A place on a polyline.

    Attributes:
        p: The point.
        direction: From point to point of the polyline, smoothed towards its corners.
    """

    p: Float[Array, " 3"]
    direction: Float[Array, " 3"]


def comb(
    tree: HairTree,
    index: Indices,
    stroke: Float[Array, "points 3"],
    radius: float,
    strength: float = 1.0,
    grip: Grip = WHOLE,
) -> HairTree:
    """Return the tree combed along a stroke.

    Where a cluster is near the stroke it is turned towards the stroke's direction
    there, the more the closer; what is behind moves along. Lengths from knot to knot
    are kept, and the root stays. A long stroke may be split, so that hair is combed
    where its first parts have brought it.

    Args:
        tree: The tree.
        index: The clusters that the comb takes, one or several.
        stroke: Points of a polyline, in the direction of the comb, in metres.
        radius: How far from the stroke hair is taken, in metres.
        strength: Share of the way to the stroke's direction, from 0 to 1.
        grip: Who follows, and where along the cluster hair is taken.

    Raises:
        ValueError: If the stroke has fewer than two points or no width.
    """
    check_stroke(stroke, radius)

    def change(cylinder: GeneralizedCylinder) -> GeneralizedCylinder:
        taken = strength * segment_weights(cylinder, grip)
        return comb_one(cylinder, stroke, jnp.asarray(radius, taken.dtype), taken)

    return edit_each(tree, index, change, grip)


def smooth(
    tree: HairTree,
    index: Indices,
    strength: float = 0.5,
    rounds: int = 4,
    grip: Grip = WHOLE,
) -> HairTree:
    """Return the tree in which a cluster's skeleton is smoother.

    Each piece of it turns towards the mean direction of its neighbours, so that waves
    go and the way remains. Lengths from knot to knot are kept, and the root stays.

    Args:
        tree: The tree.
        index: The cluster, or several.
        strength: Share of the way to the neighbours' mean in one round, from 0 to 1.
        rounds: How often.
        grip: Who follows, and where along the cluster.
    """

    def change(cylinder: GeneralizedCylinder) -> GeneralizedCylinder:
        taken = strength * segment_weights(cylinder, grip)
        for _ in range(rounds):
            cylinder = smooth_one(cylinder, taken)
        return cylinder

    return edit_each(tree, index, change, grip)


def attract(
    tree: HairTree,
    index: Indices,
    curve: Float[Array, "points 3"],
    radius: float,
    strength: float = 1.0,
    grip: Grip = WHOLE,
) -> HairTree:
    """Return the tree in which a cluster is drawn to a curve.

    From root to tip each control point goes as near to its goal as the length from the
    knot before lets it; the goal is on the way to the closest point of the curve.
    Lengths from knot to knot are kept, and the root stays.

    Args:
        tree: The tree.
        index: The cluster, or several.
        curve: Points of a polyline, in metres.
        radius: How far from the curve hair is drawn to it, in metres.
        strength: Share of the way to the curve, from 0 to 1.
        grip: Who follows, and where along the cluster hair is drawn.

    Raises:
        ValueError: If the curve has fewer than two points or no reach.
    """
    check_stroke(curve, radius)

    def change(cylinder: GeneralizedCylinder) -> GeneralizedCylinder:
        dtype = cylinder.twist.dtype
        taken = strength * jnp.asarray(grip.weights(len(cylinder.twist)), dtype)
        return attract_one(cylinder, curve, jnp.asarray(radius, dtype), taken)

    return edit_each(tree, index, change, grip)


def check_stroke(points: Float[Array, "points 3"], radius: float) -> None:
    """Raise if a polyline has no length or no width."""
    if len(points) < 2:
        raise ValueError(f"a stroke needs at least 2 points, got {len(points)}.")
    if not radius > 0.0:
        raise ValueError(f"the radius of a stroke is positive, got {radius} m.")


def segment_weights(
    cylinder: GeneralizedCylinder, grip: Grip
) -> Float[Array, " segments"]:
    """Return by how much the pieces from knot to knot take part."""
    weight = grip.weights(cylinder.twist.shape[0])
    return jnp.asarray(0.5 * (weight[1:] + weight[:-1]), cylinder.twist.dtype)


def near_polyline(
    points: Float[Array, "points 3"], p: Float[Array, " 3"]
) -> OnPolyline:
    """Return the point of a polyline that is closest to `p`."""
    first, step = points[:-1], points[1:] - points[:-1]
    square = jnp.sum(step * step, axis=1)
    share = jnp.sum((p[None] - first) * step, axis=1)
    share = jnp.clip(share / jnp.where(square > 0.0, square, 1.0), 0.0, 1.0)
    closest = first + share[:, None] * step
    rest = closest - p[None]
    at = jnp.argmin(jnp.sum(rest * rest, axis=1))
    direction = unit(step, jnp.zeros_like(step))
    before = direction[jnp.maximum(at - 1, 0)]
    after = direction[jnp.minimum(at + 1, len(step) - 1)]
    f = share[at]
    start = before + direction[at]
    end = direction[at] + after
    way = unit((1.0 - f) * start + f * end, direction[at])
    return OnPolyline(closest[at], way)


def falloff(
    distance: Float[Array, "*batch"], radius: Float[Array, ""]
) -> Float[Array, "*batch"]:
    """Return 1 at no distance, falling smoothly to 0 at the radius."""
    rest = jnp.maximum(1.0 - (distance / radius) ** 2, 0.0)
    return rest * rest


@jax.jit
def comb_one(
    cylinder: GeneralizedCylinder,
    stroke: Float[Array, "points 3"],
    radius: Float[Array, ""],
    taken: Float[Array, " segments"],
) -> GeneralizedCylinder:
    """Return one cluster combed along a stroke."""
    stroke = stroke.astype(taken.dtype)

    def turn(first, second, taken):
        step = second - first
        closest, direction = near_polyline(stroke, 0.5 * (first + second))
        weight = taken * falloff(norm(0.5 * (first + second) - closest), radius)
        along = unit(step, direction)
        way = unit((1.0 - weight) * along + weight * direction, along)
        return norm(step) * way

    skeleton = cylinder.skeleton
    steps = jax.vmap(turn)(skeleton[:-1], skeleton[1:], taken)
    return place_on(cylinder, chain(skeleton[:1], steps))


@jax.jit
def smooth_one(
    cylinder: GeneralizedCylinder, taken: Float[Array, " segments"]
) -> GeneralizedCylinder:
    """Return one cluster after one round of smoothing."""
    step = cylinder.skeleton[1:] - cylinder.skeleton[:-1]
    along = unit(step, jnp.zeros_like(step))
    before = jnp.concatenate([along[:1], along[:-1]])
    after = jnp.concatenate([along[1:], along[-1:]])
    mean = 0.5 * (before + after)
    way = unit(along + taken[:, None] * (mean - along), along)
    steps = norm(step)[:, None] * way
    return place_on(cylinder, chain(cylinder.skeleton[:1], steps))


@jax.jit
def attract_one(
    cylinder: GeneralizedCylinder,
    curve: Float[Array, "points 3"],
    radius: Float[Array, ""],
    taken: Float[Array, " knots"],
) -> GeneralizedCylinder:
    """Return one cluster drawn to a curve."""
    curve = curve.astype(taken.dtype)

    def goal(p, taken):
        closest = near_polyline(curve, p).p
        weight = taken * falloff(norm(closest - p), radius)
        return p + weight * (closest - p)

    skeleton = cylinder.skeleton
    goals = jax.vmap(goal)(skeleton, taken)
    steps = skeleton[1:] - skeleton[:-1]

    def reach(at, knot):
        goal, step = knot
        away = unit(goal - at, unit(step, jnp.zeros_like(step)))
        there = at + norm(step) * away
        return there, there

    rest = jax.lax.scan(reach, skeleton[0], (goals[1:], steps))[1]
    return place_on(cylinder, jnp.concatenate([skeleton[:1], rest]))
