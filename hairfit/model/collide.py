"""Hair that stays out of the head: the closest-point transform on a grid."""

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, ScalarLike

from ..host import on_device
from .tree import HairTree

# Steps of one round, and of the next one for what is not yet out. Most points take two,
# those in thin parts or near the middle of a body some more.
ROUNDS = (3, 9)
# How far below the gap a point counts as out. Metres.
CLOSE = 1e-5
# The gradient's length is 1 but for the creases of the distance, deep inside. Its
# square is taken for no less than this: one step shall not reach far beyond the skin.
LEAST_SQUARE = 0.5
# The fewest points that are moved at once.
FEWEST = 1024


class DistanceField(eqx.Module):
    """Signed distances from a head at the points of an even grid. Metres.

    Thesis, section 4.6.4: the closest-point transform, a table for fast look-up.

    Attributes:
        origin: The grid's first point.
        cell: Distance between neighbours.
        distance: Distance at `origin + cell * (x, y, z)`, negative inside the head.
    """

    origin: Float[Array, " 3"]
    cell: Float[Array, ""]
    distance: Float[Array, "x y z"]

    def __check_init__(self):
        if min(self.distance.shape) < 2:
            raise ValueError(
                f"`distance` needs at least 2 points along each axis, got the shape "
                f"{self.distance.shape}; take a smaller cell or a larger box."
            )


class FieldSample(NamedTuple):
    """What a distance field says at one point.

    Attributes:
        distance: Signed distance in metres, infinite outside the grid.
        gradient: Its gradient, over its squared length, so that
            `p - distance * gradient` is on the skin to first order; 0 outside the grid.
    """

    distance: Float[Array, ""]
    gradient: Float[Array, " 3"]


def sample_field(
    distance: Callable[[Float[np.ndarray, "points 3"]], Float[np.ndarray, " points"]],
    low: Sequence[float] | Float[np.ndarray, " 3"],
    high: Sequence[float] | Float[np.ndarray, " 3"],
    cell: float,
) -> DistanceField:
    """Return the distance field over the box from `low` to `high`, in metres.

    Runs outside `jit`.

    Args:
        distance: Signed distances of points, negative inside.
        low: The box's smallest corner, which is the grid's first point.
        high: Its largest corner; the grid reaches it or less than a cell beyond.
        cell: Distance between neighbours.

    Raises:
        ValueError: If the box is empty or `cell` is not positive.
    """
    low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
    if not (cell > 0.0 and (high > low).all()):
        raise ValueError(
            f"a field needs a positive cell and a box with `low` below `high`, got "
            f"{cell} m and {low} to {high}."
        )
    # A whole number of cells shall not become one more by rounding.
    count = np.ceil((high - low) / cell - 1e-6).astype(int) + 1
    axes = [low[i] + cell * np.arange(count[i]) for i in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    found = np.asarray(distance(grid.reshape(-1, 3)), np.float64)
    return DistanceField(
        on_device(low), on_device(float(cell)), on_device(found.reshape(count))
    )


def field_distance(field: DistanceField, p: Float[Array, " 3"]) -> FieldSample:
    """Return the signed distance at one point and the gradient for equation (4-9).

    The distance is trilinear. Where it is convex, as about a head, it is too large by
    up to the squared cell over 4 times the radius of curvature: 0.04 mm on a cranium
    in cells of 4 mm.

    The gradient is interpolated as well, from central differences at the grid's points
    that are divided by their squared length. Beside the gradient of the trilinear
    distance it is of second order in the cell instead of first, and continuous, so that
    neighbours on a strand stay neighbours. The division makes (4-9) a Newton step, as
    gradients are too short at creases: up to 20 mm deep in a head, two such steps come
    as near to the skin as three or four without it.

    Args:
        field: The field.
        p: A point, in metres.
    """
    return look_up(tables(field, p.dtype), p)


class Tables(NamedTuple):
    """A field as it is looked up.

    Attributes:
        origin: As in the field.
        cell: The same.
        shape: Points along each axis.
        values: The distance, and each axis of its gradient, at the grid's points.
    """

    origin: Float[Array, " 3"]
    cell: Float[Array, ""]
    shape: tuple[int, ...]
    values: tuple[Float[Array, " points"], ...]


def tables(field: DistanceField, dtype: np.dtype) -> Tables:
    """Return what is looked up, in one precision."""
    origin, cell, distance = jax.tree.map(
        lambda leaf: leaf.astype(dtype), (field.origin, field.cell, field.distance)
    )
    slopes = [slope / cell for slope in jnp.gradient(distance)]
    square = jnp.maximum(sum(slope * slope for slope in slopes), LEAST_SQUARE)
    values = (distance, *(slope / square for slope in slopes))
    flat = tuple(one.reshape(-1) for one in values)
    return Tables(origin, cell, distance.shape, flat)


class Place(NamedTuple):
    """Where a point is in a grid.

    Attributes:
        first: The first corner of its cell, or of the nearest one, along each axis.
        share: How far across the cell it is, 0 to 1, along each axis.
        inside: Whether it is in the grid.
    """

    first: tuple[Int[Array, ""], ...]
    share: tuple[Float[Array, ""], ...]
    inside: Bool[Array, ""]


def place_of(
    origin: Float[Array, " 3"],
    cell: Float[Array, ""],
    shape: tuple[int, ...],
    p: Float[Array, " 3"],
) -> Place:
    """Return where a point is in a grid of some points a side.

    Axis by axis: arrays of three would keep XLA from making one loop over all points.
    """
    first, share, inside = [], [], jnp.array(True)
    for axis in range(3):
        position = (p[axis] - origin[axis]) / cell
        corner = jnp.clip(jnp.floor(position), 0.0, shape[axis] - 2.0)
        first.append(corner.astype(jnp.int32))
        share.append(position - corner)
        inside &= (position >= 0.0) & (position <= shape[axis] - 1.0)
    return Place(tuple(first), tuple(share), inside)


def look_up(table: Tables, p: Float[Array, " 3"]) -> FieldSample:
    """Return `field_distance` from tables."""
    first, share, inside = place_of(table.origin, table.cell, table.shape, p)
    start = row_of(first, table.shape)

    def between(values):
        total = jnp.zeros((), p.dtype)
        for corner in itertools.product((0, 1), repeat=3):
            weight = [s if c else 1.0 - s for c, s in zip(corner, share, strict=True)]
            row = start + row_of(corner, table.shape)
            total += math.prod(weight) * values.at[row].get(mode="clip")
        return jnp.where(inside, total, 0.0)

    distance, *gradient = map(between, table.values)
    return FieldSample(jnp.where(inside, distance, jnp.inf), jnp.stack(gradient))


def row_of(index: Sequence, shape: tuple[int, ...]):
    """Return where a point of the grid stands in the flat tables."""
    return (index[0] * shape[1] + index[1]) * shape[2] + index[2]


class Moved(NamedTuple):
    """Points on their way out.

    Attributes:
        points: Where they are now, in metres.
        below: Whether they are still below the gap.
    """

    points: Float[Array, "points 3"]
    below: Bool[Array, " points"]


@functools.partial(jax.jit, static_argnames="steps")
def move_out(
    field: DistanceField, points: Float[Array, "points 3"], gap: ScalarLike, steps: int
) -> Moved:
    """Return points after some steps of equation (4-9)."""
    table = tables(field, points.dtype)
    above = jnp.asarray(gap, points.dtype)
    look = jax.vmap(look_up, (None, 0))

    def step(p, _):
        distance, gradient = look(table, p)
        depth = jnp.minimum(distance - above, 0.0)
        return p - depth[:, None] * gradient, None

    points = jax.lax.scan(step, points, None, length=steps)[0]
    return Moved(points, look(table, points).distance < above - CLOSE)


def push_out_points(
    field: DistanceField, points: Float[Array, "points 3"], gap: ScalarLike
) -> Float[Array, "points 3"]:
    r"""Return points, those under the skin moved out of it by equation (4-9).

    $p_{new} = p - \min(D(p) - g, 0) \nabla(p)$, over and over: with a gap $g$ the skin
    is the surface at $g$ above the head's. The thesis moves what is inside ($D < 0$)
    onto the skin itself; to move what is below the gap, and only as far, keeps the map
    continuous. Points above the gap or outside the grid come back as they are.

    Points are moved one by one: between two that are out, a segment may still cut
    through the skin, by its sagitta.

    Differentiable in `points`.

    Args:
        field: The head.
        points: Points, in metres.
        gap: Least distance above the skin, in metres.
    """
    return move_out(field, points, gap, sum(ROUNDS)).points


def push_out_strands(
    field: DistanceField,
    strands: Float[Array | np.ndarray, "strands points 3"],
    gap: ScalarLike,
) -> Float[Array, "strands points 3"]:
    """Return strands, all but their roots moved out of the head (4-9, figure 4-22).

    Only points in cells that reach under the gap are looked at closely, and after some
    steps only those that are not yet out. Their number is rounded up, so that few
    programs are compiled. Runs outside `jit`; within it, or for gradients, call
    `push_out_points`.

    Args:
        field: The head.
        strands: Strands, root first, in metres.
        gap: Least distance above the skin, in metres.
    """
    below = may_be_below(field, jnp.asarray(strands), gap)
    mine = np.flatnonzero(np.asarray(below))
    points = np.array(strands).reshape(-1, 3)
    for steps in ROUNDS:
        if len(mine):
            # Four sizes an octave; what is filled up repeats points.
            size = max(FEWEST, 1 << max(len(mine).bit_length() - 3, 0))
            some = np.resize(mine, -(-len(mine) // size) * size)
            moved = move_out(field, jnp.asarray(points.take(some, axis=0)), gap, steps)
            points[mine] = np.asarray(moved.points)[: len(mine)]
            mine = mine[np.asarray(moved.below)[: len(mine)]]
    return jnp.asarray(points.reshape(strands.shape))


@jax.jit
def may_be_below(
    field: DistanceField, strands: Float[Array, "strands points 3"], gap: ScalarLike
) -> Bool[Array, "strands points"]:
    """Return which points are in a cell that is partly below the gap; roots are not."""
    low = field.distance
    for axis in range(3):  # the least of a cell's corners bounds what is between them
        ahead = jax.lax.slice_in_dim(low, 1, None, axis=axis)
        low = jnp.minimum(jax.lax.slice_in_dim(low, 0, -1, axis=axis), ahead)
    risky = (low < jnp.asarray(gap, low.dtype)).reshape(-1)
    origin, cell = field.origin.astype(strands.dtype), field.cell.astype(strands.dtype)
    shape = low.shape

    def test(p):
        first, _, inside = place_of(origin, cell, field.distance.shape, p)
        row = row_of(first, shape)
        return inside & risky.at[row].get(mode="clip")

    below = jax.vmap(jax.vmap(test))(strands)
    return below & (jnp.arange(strands.shape[1]) > 0)[None]


def push_out_tree(field: DistanceField, tree: HairTree, gap: ScalarLike) -> HairTree:
    """Return the tree with its skeletons moved out of the head by equation (4-9).

    Control points are moved, but for the roots, in clusters of all levels. The hair
    around a skeleton may still enter the head: that is for `push_out_strands`.
    Differentiable in the skeletons.

    Args:
        field: The head.
        tree: The tree.
        gap: Least distance of the control points above the skin, in metres.
    """
    skeleton = tree.cylinder.skeleton
    rest = skeleton[:, 1:]
    moved = push_out_points(field, rest.reshape(-1, 3), gap).reshape(rest.shape)
    skeleton = jnp.concatenate([skeleton[:, :1], moved], axis=1)
    return eqx.tree_at(lambda t: t.cylinder.skeleton, tree, skeleton)
