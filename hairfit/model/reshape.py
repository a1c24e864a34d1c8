"""What a user does to one cluster: move, rotate, scale, twist, bend and curl it."""

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, ScalarLike

from .curve import EXACT, arc_length
from .cylinder import GeneralizedCylinder, cylinder_frames
from .edit import WHOLE, Grip, edit_each
from .section import carry, on_skeleton, rotation, turns_along
from .tree import HairTree
from .vector import unit

Indices = int | Sequence[int] | np.ndarray
Vector = Float[Array | np.ndarray, " 3"]

# Knots that one turn of a curl needs, to be round.
KNOTS_A_TURN = 4.0


@dataclasses.dataclass(frozen=True)
class Curl:
    """Curls, or waves. Metres.

    Attributes:
        radius: Radius of the helix.
        pitch: Length of one turn along the cluster.
        depth: Share of the third dimension: 1 for a helix, 0 for waves in the plane
            of the tangent and the normal.
        start: Share of the length from which on hair curls.
        ramp: Share of the length over which the radius grows to its full size.
        phase: Angle of the helix at the root, in radians.
    """

    radius: float
    pitch: float
    depth: float = 1.0
    start: float = 0.0
    ramp: float = 0.2
    phase: float = 0.0


def move(
    tree: HairTree, index: Indices, vector: Vector, grip: Grip = WHOLE
) -> HairTree:
    """Return the tree in which control points of a cluster are moved.

    All of them by the same vector, or those around the picked one (figure 4-16b). The
    root stays on the scalp unless it is the one that is picked.

    Args:
        tree: The tree.
        index: The cluster, or several.
        vector: Where to, in metres.
        grip: What is moved, and who follows.
    """

    def change(cylinder: GeneralizedCylinder) -> GeneralizedCylinder:
        weight = rooted(cylinder, grip)
        step = weight[:, None] * jnp.asarray(vector, weight.dtype)[None]
        return place_on(cylinder, cylinder.skeleton + step)

    return edit_each(tree, index, change, grip)


def rotate(
    tree: HairTree,
    index: Indices,
    axis: Vector,
    angle: ScalarLike,
    grip: Grip = WHOLE,
) -> HairTree:
    """Return the tree in which a cluster is turned about an axis through a knot.

    The axis goes through the picked control point, and what is around it is turned;
    the whole cluster is turned about its root.

    Args:
        tree: The tree.
        index: The cluster, or several.
        axis: Direction of the axis, of any length.
        angle: In radians.
        grip: What is turned, and who follows.
    """

    def change(cylinder: GeneralizedCylinder) -> GeneralizedCylinder:
        knots, dtype = cylinder.twist.shape[0], cylinder.twist.dtype
        weight = jnp.asarray(grip.weights(knots), dtype)
        about, angles = unit_axis(axis, dtype), weight * jnp.asarray(angle, dtype)
        turns = turn_about(about, angles)
        at = 0.0 if grip.knot is None else grip.knot
        low = min(int(at), knots - 2)
        first, second = cylinder.skeleton[low], cylinder.skeleton[low + 1]
        centre = first + (at - low) * (second - first)
        arms = cylinder.skeleton - centre[None]
        arms = jnp.einsum("kij,kj->ki", turns, arms, precision=EXACT)
        return turn_on(cylinder, centre[None] + arms, about, angles)

    return edit_each(tree, index, change, grip)


def scale(
    tree: HairTree, index: Indices, factors: Sequence[float] | Array, grip: Grip = WHOLE
) -> HairTree:
    r"""Return the tree in which a cluster is scaled across its skeleton (figure 4-16c).

    $S_N$ and $S_B$ are multiplied, around the picked control point or everywhere, and
    the shear with $S_N$.

    Args:
        tree: The tree.
        index: The cluster, or several.
        factors: For the normal and for the binormal.
        grip: What is scaled, and who follows.
    """

    def change(cylinder: GeneralizedCylinder) -> GeneralizedCylinder:
        knots, dtype = cylinder.twist.shape[0], cylinder.twist.dtype
        weight = jnp.asarray(grip.weights(knots), dtype)[:, None]
        by = 1.0 + weight * (jnp.asarray(factors, dtype)[None] - 1.0)
        return eqx.tree_at(
            lambda c: (c.scale, c.shear),
            cylinder,
            (cylinder.scale * by, cylinder.shear * by[:, 0]),
        )

    return edit_each(tree, index, change, grip)


def twist(
    tree: HairTree, index: Indices, angle: ScalarLike, grip: Grip = WHOLE
) -> HairTree:
    """Return the tree in which a cluster is twisted about its skeleton (figure 4-16d).

    Around the picked control point; a whole cluster is turned evenly more from root to
    tip, where the angle is reached.

    Args:
        tree: The tree.
        index: The cluster, or several.
        angle: In radians; many turns make curls of the clusters below.
        grip: What is twisted, and who follows.
    """

    def change(cylinder: GeneralizedCylinder) -> GeneralizedCylinder:
        knots, dtype = cylinder.twist.shape[0], cylinder.twist.dtype
        weight = grip.weights(knots)
        if grip.knot is None:
            weight = np.linspace(0.0, 1.0, knots)
        more = jnp.asarray(weight, dtype) * jnp.asarray(angle, dtype)
        return eqx.tree_at(lambda c: c.twist, cylinder, cylinder.twist + more)

    return edit_each(tree, index, change, grip)


def bend(
    tree: HairTree,
    index: Indices,
    axis: Vector,
    angle: ScalarLike,
    span: tuple[float, float] = (0.0, 1.0),
    grip: Grip = WHOLE,
) -> HairTree:
    """Return the tree in which a cluster is bent about an axis.

    The angle is spread evenly along a span of the skeleton; what is behind it is turned
    as a whole. All lengths from knot to knot are kept, and the root stays.

    Args:
        tree: The tree.
        index: The cluster, or several.
        axis: Direction of the axis, of any length.
        angle: In radians.
        span: Where the bend begins and ends, as shares of the knots.
        grip: Who follows; which knot is picked does not matter.

    Raises:
        ValueError: If the span does not end behind its begin.
    """
    begin, end = span
    if not begin < end:
        raise ValueError(f"a bend ends behind its begin, got the span {span}.")

    def change(cylinder: GeneralizedCylinder) -> GeneralizedCylinder:
        knots, dtype = cylinder.twist.shape[0], cylinder.twist.dtype
        t = np.linspace(0.0, 1.0, 2 * knots - 1)  # knots, and the middles between them
        share = jnp.asarray(np.clip((t - begin) / (end - begin), 0.0, 1.0), dtype)
        about = unit_axis(axis, dtype)
        angles = share * jnp.asarray(angle, dtype)
        turns = turn_about(about, angles[1::2])
        steps = cylinder.skeleton[1:] - cylinder.skeleton[:-1]
        steps = jnp.einsum("kij,kj->ki", turns, steps, precision=EXACT)
        skeleton = chain(cylinder.skeleton[:1], steps)
        return turn_on(cylinder, skeleton, about, angles[::2])

    return edit_each(tree, index, change, grip)


def curl(tree: HairTree, index: Indices, how: Curl, grip: Grip = WHOLE) -> HairTree:
    """Return the tree in which a cluster winds round its skeleton.

    Control points go to a helix about the skeleton, in its frames; the root stays.
    Skeletons lengthen by it, as hair that is to curl must be longer.

    Args:
        tree: The tree.
        index: The cluster, or several.
        how: The curls.
        grip: Who follows, and where along the cluster hair curls.

    Raises:
        ValueError: If there are too few knots for a turn.
    """

    def change(cylinder: GeneralizedCylinder) -> GeneralizedCylinder:
        check_turns(cylinder, how.pitch)
        weight = rooted(cylinder, grip)
        along = arc_length(cylinder.skeleton)
        share = along / along[-1]
        grown = jnp.clip((share - how.start) / max(how.ramp, 1e-3), 0.0, 1.0)
        grown = how.radius * weight * grown * grown * (3.0 - 2.0 * grown)
        angle = (2.0 * jnp.pi / how.pitch) * along + how.phase
        frames = cylinder_frames(cylinder)
        across = (grown * jnp.cos(angle))[:, None] * frames.normal
        deep = (how.depth * grown * jnp.sin(angle))[:, None] * frames.binormal
        return place_on(cylinder, cylinder.skeleton + across + deep)

    return edit_each(tree, index, change, grip)


def check_turns(cylinder: GeneralizedCylinder, pitch: float) -> None:
    """Raise if a cluster has too few knots for turns of a pitch."""
    if isinstance(cylinder.skeleton, Tracer):
        return  # while differentiating, the length is not known
    skeleton = np.asarray(cylinder.skeleton)
    length = np.linalg.norm(np.diff(skeleton, axis=0), axis=1).sum()
    need = int(np.ceil(KNOTS_A_TURN * length / pitch)) + 1
    if len(skeleton) < need:
        raise ValueError(
            f"turns of {pitch} m on a cluster of {length:.3f} m need {need} knots, it "
            f"has {len(skeleton)}; resample the tree's knots first."
        )


def rooted(cylinder: GeneralizedCylinder, grip: Grip) -> Float[Array, " knots"]:
    """Return by how much control points are moved: the root only if it is picked."""
    weight = grip.weights(cylinder.twist.shape[0])
    if grip.knot != 0:
        weight[0] = 0.0
    return jnp.asarray(weight, cylinder.twist.dtype)


def unit_axis(axis: Vector, dtype) -> Float[Array, " 3"]:
    """Return the direction of an axis; of one without length, straight up."""
    return unit(jnp.asarray(axis, dtype), jnp.array([0.0, 1.0, 0.0], dtype))


@jax.jit
def turn_about(
    axis: Float[Array, " 3"], angles: Float[Array, " knots"]
) -> Float[Array, "knots 3 3"]:
    """Return rotations about one axis."""
    return jax.vmap(rotation, (None, 0))(axis, angles)


@jax.jit
def turn_on(
    cylinder: GeneralizedCylinder,
    skeleton: Float[Array, "knots 3"],
    axis: Float[Array, " 3"],
    angles: Float[Array, " knots"],
) -> GeneralizedCylinder:
    """Return one cluster on a skeleton, its cross-sections turned about an axis."""
    turns = turns_along(skeleton, jnp.tile(axis[None], (len(angles), 1)), angles)
    return carry(cylinder, skeleton, turn_about(axis, angles), turns)


def chain(
    root: Float[Array, "1 3"], steps: Float[Array, "segments 3"]
) -> Float[Array, "knots 3"]:
    """Return the skeleton that goes from a root in given steps."""
    return jnp.concatenate([root, root + jnp.cumsum(steps, axis=0)])


place_on = jax.jit(on_skeleton)
