"""Partings: hair combed away from a line on the scalp, to either side."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .cylinder import GeneralizedCylinder
from .edit import WHOLE, Grip, edit_cluster
from .reshape import place_on
from .scalp import Scalp, scalp_normal, scalp_point, scalp_uv
from .stroke import falloff, near_polyline
from .tiling import part_tree
from .tree import HairTree, children, cluster, descendants, leaves
from .vector import norm, reject, unit

# Points on the scalp from corner to corner of a parting.
FINE = 16


@dataclasses.dataclass(frozen=True)
class Parting:
    """How hair is parted.

    Attributes:
        reach: How far from the parting hair is combed, in metres.
        length: Over which length from its root, in metres.
        strength: Share of the way to lying flat and away from the parting, 0 to 1.
        cut: Whether contours end at the parting.
    """

    reach: float = 0.05
    length: float = 0.08
    strength: float = 0.7
    cut: bool = True


def part(
    tree: HairTree,
    line: Float[Array | np.ndarray, "points 2"],
    how: Parting | None = None,
    grip: Grip = WHOLE,
) -> HairTree:
    """Return the tree with a parting along a polyline on the scalp.

    Clusters near the parting are combed away from it, on the side that they are rooted
    on. Over the given length from their roots they turn to the direction along the
    scalp that leads away; for as long again they do not enter it, and what of their way
    leads back is turned round. Lengths from knot to knot are kept. Hair that hung far
    across the new parting has to be combed further by hand. A cluster whose leaves
    stand on both sides stays; those below it are combed instead.

    Contours of clusters that stand on one side are cut at the parting, as
    `tiling.part_tree` has it: roots beyond it go to clusters of the other side that
    contain them. Hair that is combed onto the head shall be pushed out afterwards.

    Args:
        tree: The tree.
        line: The parting in scalp space, 2 points or more.
        how: How hair is parted; None for a usual way.
        grip: Who follows; which knot is picked does not matter.

    Raises:
        ValueError: If the parting has fewer than two points.
    """
    if len(line) < 2:
        raise ValueError(f"a parting needs at least 2 points, got {len(line)}.")
    how = Parting() if how is None else how
    dtype = tree.scalp.control.dtype
    fine = jnp.asarray(on_line(np.asarray(line, float)), dtype)
    away = away_from(tree.scalp, fine, tree.contour.centre)
    one_sided = on_one_side(tree, np.asarray(away.side))
    amounts = jnp.asarray([how.reach, how.length, how.strength], dtype)
    for index in one_sided:
        place = jax.tree.map(lambda leaf, i=index: leaf[i], away)
        new = part_one(tree.scalp, cluster(tree.cylinder, index), place, amounts)
        tree = edit_cluster(
            tree, index, new, grip.binder_of, whole_skeleton=grip.whole_skeleton
        )
    if not how.cut:
        return tree
    cut = [np.concatenate([[i], descendants(tree, i)]) for i in one_sided]
    return part_tree(tree, [jnp.asarray(line, dtype)], np.concatenate(cut))


def on_one_side(tree: HairTree, side: Float[np.ndarray, " clusters"]) -> list[int]:
    """Return the highest clusters whose leaves all stand on one side of a parting."""
    is_leaf = np.zeros(tree.count, bool)
    is_leaf[leaves(tree)] = True
    found = []
    waiting = children(tree, -1).tolist()
    while waiting:
        index = waiting.pop()
        family = np.concatenate([[index], descendants(tree, index)])
        below = side[family[is_leaf[family]]]
        if np.all(below == below[0]):
            found.append(index)
        else:
            waiting += children(tree, index).tolist()
    return sorted(found)


def on_line(line: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "fine 2"]:
    """Return a polyline with more points."""
    corner = np.arange(len(line))
    at = np.linspace(0.0, len(line) - 1.0, FINE * (len(line) - 1) + 1)
    return np.stack([np.interp(at, corner, x) for x in line.T], axis=1)


class Away(NamedTuple):
    """Where a root stands beside a parting.

    Attributes:
        direction: The direction along the scalp that leads away from the parting.
        distance: How far away it is, in metres.
        side: 1 or -1.
    """

    direction: Float[Array, "*batch 3"]
    distance: Float[Array, "*batch"]
    side: Float[Array, "*batch"]


@jax.jit
def away_from(
    scalp: Scalp, line: Float[Array, "points 2"], uv: Float[Array, "roots 2"]
) -> Away:
    """Return where roots stand beside a line on the scalp."""
    points = jax.vmap(scalp_point, (None, 0))(scalp, line)

    def one(uv):
        root, up = scalp_point(scalp, uv), scalp_normal(scalp, uv)
        near = near_polyline(points, root)
        across = reject(jnp.cross(up, near.direction), up)
        rest = root - near.p
        side = jnp.where(jnp.dot(rest, across) >= 0.0, 1.0, -1.0).astype(uv.dtype)
        return Away(side * across, norm(rest), side)

    return jax.vmap(one)(uv)


@jax.jit
def part_one(
    scalp: Scalp,
    cylinder: GeneralizedCylinder,
    away: Away,
    amounts: Float[Array, " 3"],
) -> GeneralizedCylinder:
    """Return one cluster combed away from a parting.

    Args:
        scalp: The scalp, along which hair is combed.
        cylinder: The cluster.
        away: Where its root is.
        amounts: Reach, length and strength of `Parting`.
    """
    reach, length, strength = amounts
    skeleton = cylinder.skeleton
    step = skeleton[1:] - skeleton[:-1]
    size = norm(step)
    middle = jnp.cumsum(size) - 0.5 * size
    share = strength * falloff(away.distance, reach)
    flat, laid = (share * falloff(middle, x * length) for x in (1.0, 2.0))

    def lay(state, piece):
        at, outward = state
        along, size, flat, laid = piece
        up = scalp_normal(scalp, scalp_uv(scalp, at))
        outward = reject(outward, up)
        way = unit((1.0 - flat) * along + flat * outward, along)
        across = jnp.minimum(jnp.dot(way, outward), 0.0)
        way = unit(way - 2.0 * laid * across * outward, way)
        inward = jnp.minimum(jnp.dot(way, up), 0.0)
        way = unit(way - laid * inward * up, way)
        at = at + size * way
        return (at, outward), at

    along = unit(step, jnp.zeros_like(step))
    start = skeleton[0], away.direction
    rest = jax.lax.scan(lay, start, (along, size, flat, laid))[1]
    return place_on(cylinder, jnp.concatenate([skeleton[:1], rest]))
