"""The tree against the photographs, coarse level first.

A root cluster that moves takes its children along: each of their control points keeps
its place in the frame of the parent's section [Kim02, section 4.6.1]. That lets one
number move thousands of strands, also where no photograph looks.
"""

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.sharding import Mesh
from jaxtyping import Array, Bool, Float, Int

from ..capture.capture import View
from ..host import on_device
from ..model.cylinder import (
    GeneralizedCylinder,
    cylinder_frames,
    frames_of,
    knot_sections,
    section_points,
)
from ..model.detail import PAIRS
from ..model.frame import Frames
from ..model.tree import HairTree, depths_of, filled, with_cylinders
from .devices import BY_BOTH, BY_STRAND, BY_VIEW, EVERYWHERE, device_mesh, put
from .residuals import (
    PhotoMaps,
    Pulls,
    bare_loss,
    find_pulls,
    image_loss,
    seen_segments,
)
from .samples import Placed, Samples, grow_placed, place
from .volume import Gaps, HairVolume, field_loss, find_gaps, gap_loss, head_loss

FULL_PACE = 0.015  # metres between knots, from which on they move at the full rate
STEADY = 0.4  # times a cluster's width between its knots, likewise
LEAST_PACE = 0.001
SHORTEST = 1e-4  # metres: a piece of a strand counts as no shorter
FREE_TURN = 0.5  # radians that strands turn at a joint before it counts as a kink
ZIGZAG = 1.0  # likewise of skeletons, whose knots may be far apart
ZIGZAGS_COUNT = 4.0  # against kinks of strands


@dataclasses.dataclass(frozen=True)
class RefineConfig:
    """How the tree is refined. Metres, radians."""

    rounds: int = 3
    """How often visibility is found anew, on each level."""
    steps: int = 20
    """Steps of Adam a round."""
    strands: int = 3000
    points: int = 24
    rate: float = 0.0004
    """How far a control point moves in a step."""
    rate_map: float = 0.01
    """How far scale, twist and shear go in a step."""
    sigma_move: float = 0.01
    sigma_bend: float = 0.002
    sigma_stretch: float = 0.5
    """By what share pieces of strands grow longer or shorter."""
    sigma_turn: float = 0.1
    """By how much more than freely strands turn from a segment to the next, radians."""
    sigma_map: float = 0.2
    field: float = 1.0
    """What the direction of the evidence, all through the hair, counts."""
    gap: float = 1.0
    """What hair counts that no strand is near, within the hull."""
    lowest_alone: bool = False
    """Whether clusters of the lowest level move alone."""


class Moves(NamedTuple):
    """What is added to the clusters of one level."""

    skeleton: Float[Array, "clusters knots 3"]
    scale: Float[Array, "clusters knots 2"]
    twist: Float[Array, "clusters knots"]
    shear: Float[Array, "clusters knots"]


class Photographs(NamedTuple):
    """What is compared with: the photographs, the head's depths in them, their maps."""

    views: Sequence[View]
    depths: Sequence[Float[np.ndarray, "_height _width"]]
    maps: PhotoMaps


class Found(NamedTuple):
    """What is found anew each round, from strands as they are."""

    seen: Bool[Array, "views strands segments"]
    pulls: Pulls
    gaps: Gaps


class Problem(NamedTuple):
    """All that a loss needs besides the moves.

    Attributes:
        cylinder: The clusters as they were before this level.
        frames: Their frames.
        level: Their levels; -1 for those that only fill the arrays.
        placed: The strands that are compared.
        maps: What photographs say.
        volume: What is known of the space around.
    """

    cylinder: GeneralizedCylinder
    frames: Frames
    level: Int[Array, " clusters"]
    placed: Placed
    maps: PhotoMaps
    volume: HairVolume


class Turn(NamedTuple):
    """The clusters that move, and what each cluster is carried by.

    Attributes:
        level: The level that moves.
        above: Each cluster's ancestor on that level; itself on it and above.
    """

    level: Int[Array, ""]
    above: Int[Array, " clusters"]


class Guide(NamedTuple):
    """What those below a cluster are carried by: its skeleton, frames and twist."""

    skeleton: Float[Array, "knots 3"]
    frames: Frames
    twist: Float[Array, " knots"]


def refine(
    tree: HairTree,
    samples: Samples,
    photographs: Photographs,
    volume: HairVolume,
    places: Float[np.ndarray, "places 3"],
    config: RefineConfig | None = None,
    progress: Callable[[float], None] = lambda share: None,
    *,
    room: int = 0,
    enough: Callable[[], bool] = lambda: False,
) -> HairTree:
    """Return the tree after gradient descent on the photographs' residuals.

    Args:
        tree: The tree, of any number of levels.
        samples: Strands to compare, each owned by a leaf.
        photographs: What they are compared with.
        volume: What is known of the space around: the head, the direction of hair.
        places: Where there should be hair, in metres.
        config: How far to go.
        progress: Called with the share that is done.
        room: Arrays hold so many clusters, if the tree has fewer: trees of different
            counts then share their compiled programs.
        enough: Asked before each round; no more is done once it says so.
    """
    config = config or RefineConfig()
    views, depths, maps = photographs
    mesh = device_mesh(len(views), len(samples.owner))
    problem = shared_out(problem_of(tree, samples, maps, volume, room), mesh)
    steps = on_device(config.steps, jnp.int32)
    count = int(depths_of(tree.parent).max()) + 1
    first = count - 1 if config.lowest_alone else 0
    done = 0
    for at in range(first, count):
        turn = turn_of(tree, at, room)
        moves = still(problem.cylinder)
        before = grow_placed(problem.cylinder, problem.placed, config.points)
        current = move(problem, moves, turn)
        for _ in range(config.rounds):
            if enough():
                break
            strands = np.asarray(grow_placed(current, problem.placed, config.points))
            found = Found(
                put(mesh, on_device(seen_segments(strands, views, depths)), BY_BOTH),
                put(mesh, find_pulls(strands, views, depths, done), BY_VIEW),
                put(mesh, find_gaps(strands, places, done), EVERYWHERE),
            )
            moves = descend(problem, before, moves, found, turn, steps, config, mesh)
            current = move(problem, moves, turn)
            done += 1
            progress(done / ((count - first) * config.rounds))
        problem = problem._replace(cylinder=current, frames=frames_of(current))
    return with_cylinders(tree, problem.cylinder)


def problem_of(
    tree: HairTree, samples: Samples, maps: PhotoMaps, volume: HairVolume, room: int = 0
) -> Problem:
    """Return what a loss needs, in arrays that hold `room` clusters or more."""
    spare = max(0, room - tree.count)
    level = np.pad(depths_of(tree.parent), (0, spare), constant_values=-1)
    clusters = filled(tree, room)
    return Problem(
        clusters.cylinder,
        frames_of(clusters.cylinder),
        on_device(level, jnp.int32),
        place(tree.scalp, clusters, samples),
        maps,
        volume,
    )


def turn_of(tree: HairTree, level: int, room: int = 0) -> Turn:
    """Return the turn of a level, in arrays that hold `room` clusters or more."""
    spare = range(tree.count, max(room, tree.count))
    above = [*ancestors(tree.parent, level), *spare]
    return Turn(on_device(level, jnp.int32), on_device(above, jnp.int32))


def ancestors(parent: tuple[int, ...], level: int) -> list[int]:
    """Return each cluster's ancestor on a level; itself on that level or above it."""
    depth = depths_of(parent)
    found: list[int] = []
    for index, above in enumerate(parent):
        found.append(index if depth[index] <= level else found[above])
    return found


def still(cylinder: GeneralizedCylinder) -> Moves:
    """Return the moves that move nothing."""
    return Moves(
        jnp.zeros_like(cylinder.skeleton),
        jnp.zeros_like(cylinder.scale),
        jnp.zeros_like(cylinder.twist),
        jnp.zeros_like(cylinder.shear),
    )


def moved(problem: Problem, moves: Moves, turn: Turn) -> GeneralizedCylinder:
    """Return the clusters after the moves of one level, descendants carried along.

    The moves of other levels' clusters are not looked at.
    """
    before = problem.cylinder
    mine = problem.level == turn.level

    def add(values, change):
        shape = (-1,) + (1,) * (values.ndim - 1)
        return values + jnp.where(mine.reshape(shape), change, 0.0)

    # Roots stay: the first knot of a skeleton lies on the scalp.
    skeleton = moves.skeleton.at[:, 0].set(0.0)
    after = eqx.tree_at(
        lambda c: (c.skeleton, c.scale, c.twist, c.shear),
        before,
        (
            add(before.skeleton, skeleton),
            add(before.scale, before.scale * moves.scale),
            add(before.twist, moves.twist),
            add(before.shear, moves.shear),
        ),
    )
    old = Guide(before.skeleton, problem.frames, before.twist)
    new = Guide(after.skeleton, jax.vmap(cylinder_frames)(after), after.twist)
    old, new = jax.tree.map(lambda leaf: leaf[turn.above], (old, new))
    carried = jax.vmap(carry)(old, new, before.skeleton)
    follows = problem.level > turn.level
    kept = jnp.where(follows[:, None, None], carried, after.skeleton)
    return eqx.tree_at(lambda c: c.skeleton, after, kept)


move = jax.jit(moved)
"""`moved`, compiled."""


def paces(cylinder: GeneralizedCylinder) -> Float[Array, " clusters"]:
    """Return by what share of the rates each cluster moves in a step.

    Adam goes at its rate however weak a gradient is. Knots that are nearer to each
    other than a few steps would be thrown into disorder. A knot that moves also tilts
    the section there: strands at its rim go as much farther as the cluster is wider
    than its knots are apart, which is far where short hair stands on much of a head.
    """
    ways = jnp.diff(cylinder.skeleton, axis=1)
    apart = jnp.mean(jnp.sqrt(jnp.sum(ways**2, axis=2) + SHORTEST**2), axis=1)
    wide = jnp.sqrt(jnp.mean(squared_widths(cylinder), axis=(1, 2)) + SHORTEST**2)
    bends, tilts = apart / FULL_PACE, apart / (STEADY * wide)
    pace = jnp.minimum(bends, 1.0) * jnp.minimum(tilts, 1.0)
    return jnp.maximum(pace, LEAST_PACE)


def squared_widths(
    cylinder: GeneralizedCylinder,
) -> Float[Array, "clusters angles knots"]:
    """Return the squared distances of contours from their skeletons, all around."""
    dtype = cylinder.skeleton.dtype
    angle = jnp.arange(2 * PAIRS, dtype=dtype) * (jnp.pi / PAIRS)
    # They are the same in any frames, about any skeleton.
    centre = jnp.zeros(cylinder.skeleton.shape[1:], dtype)
    axes = Frames(
        *(jnp.broadcast_to(row, centre.shape) for row in jnp.eye(3, dtype=dtype))
    )

    def one(mine, theta):
        sections = knot_sections(mine, axes, theta)._replace(centre=centre)
        return jnp.sum(section_points(sections, 1.0, theta) ** 2, axis=1)

    return jax.vmap(jax.vmap(one, (None, 0)), (0, None))(cylinder, angle)


def stretched(
    before: Float[Array, "strands knots 3"], after: Float[Array, "strands knots 3"]
) -> Float[Array, "strands segments"]:
    """Return by what share the segments of strands have become longer."""
    old, new = (
        jnp.sqrt(jnp.sum(jnp.diff(points, axis=1) ** 2, axis=2) + SHORTEST**2)
        for points in (before, after)
    )
    return new / old - 1.0


def turns(
    strands: Float[Array, "strands knots 3"],
) -> Float[Array, "strands joints"]:
    """Return the square of how far each segment's direction is from the last one's.

    It is that of the angle for small ones, and 4 where a strand turns back.
    """
    ways = jnp.diff(strands, axis=1)
    square = jnp.sum(ways**2, axis=2, keepdims=True)
    return jnp.sum(jnp.diff(ways / jnp.sqrt(square + SHORTEST**2), axis=1) ** 2, axis=2)


def beyond(free: float, strands: Float[Array, "strands knots 3"]) -> Float[Array, ""]:
    """Return the mean of what `turns` have beyond a free turn, in radians."""
    return jnp.mean(jnp.maximum(turns(strands) - free**2, 0.0))


def carry(
    before: Guide, after: Guide, skeleton: Float[Array, "knots 3"]
) -> Float[Array, "knots 3"]:
    """Return a skeleton after an ancestor's cylinder has changed.

    Its knot `k` keeps its coordinates in the frame at knot `k` of the ancestor.
    """
    axes, turned = (jnp.stack(one.frames, axis=1) for one in (before, after))
    local = jnp.einsum("kij,kj->ki", axes, skeleton - before.skeleton)
    twist = after.twist - before.twist
    cos, sin = jnp.cos(twist), jnp.sin(twist)
    normal = cos * local[:, 1] - sin * local[:, 2]
    binormal = sin * local[:, 1] + cos * local[:, 2]
    local = jnp.stack([local[:, 0], normal, binormal], axis=1)
    return after.skeleton + jnp.einsum("ki,kij->kj", local, turned)


def shared_out(problem: Problem, mesh: Mesh | None) -> Problem:
    """Return what a loss needs, as it is shared out over devices."""
    return put(mesh, problem, EVERYWHERE)._replace(
        placed=put(mesh, problem.placed, BY_STRAND),
        maps=put(mesh, problem.maps, BY_VIEW),
    )


@functools.partial(jax.jit, static_argnames=("config", "mesh"))
def descend(
    problem: Problem,
    before: Float[Array, "strands points 3"],
    moves: Moves,
    given: Found,
    turn: Turn,
    steps: Int[Array, ""],
    config: RefineConfig,
    mesh: Mesh | None = None,
) -> Moves:
    """Return the moves after so many steps of Adam; strands were `before` them."""
    # Clusters that only fill the arrays do not move, and do not count.
    filled = problem.level.size / jnp.sum(problem.level >= 0, dtype=before.dtype)

    def loss(moves):
        cylinder = moved(problem, moves, turn)
        strands = grow_placed(cylinder, problem.placed, config.points)
        bend = jnp.diff(moves.skeleton, n=2, axis=1) / config.sigma_bend
        prior = jnp.mean((moves.skeleton / config.sigma_move) ** 2) + jnp.mean(bend**2)
        for change in (moves.scale, moves.twist, moves.shear):
            prior += jnp.mean((change / config.sigma_map) ** 2)
            prior += jnp.mean((jnp.diff(change, axis=1) / config.sigma_map) ** 2)
        stretch = stretched(before, strands) / config.sigma_stretch
        prior = filled * prior + jnp.mean(stretch**2)
        kinks = beyond(FREE_TURN, strands)
        # A skeleton may turn to and fro between the points of its strands.
        kinks += ZIGZAGS_COUNT * filled * beyond(ZIGZAG, cylinder.skeleton)
        prior += kinks / config.sigma_turn**2
        found = image_loss(strands, given.seen, problem.maps, mesh)
        found += bare_loss(strands, given.pulls, problem.maps)
        found += config.field * field_loss(strands, problem.volume)
        found += config.gap * gap_loss(strands, given.gaps)
        return found + head_loss(strands, problem.volume.head) + 0.1 * prior

    pace = paces(problem.cylinder)
    optimizer = optax.partition(
        {
            "metres": optax.adam(config.rate, b1=0.8, b2=0.95),
            "map": optax.adam(config.rate_map, b1=0.8, b2=0.95),
        },
        Moves("metres", "map", "map", "map"),  # pyright: ignore[reportArgumentType]
    )

    def step(_, state):
        moves, memory = state
        gradient = jax.grad(loss)(moves)
        # Adam's bias correction takes a power of a float by an integer.
        with jax.numpy_dtype_promotion("standard"):
            updates, memory = optimizer.update(gradient, memory)

        def add(move, update):
            return move + update * pace.reshape(-1, *[1] * (update.ndim - 1))

        return jax.tree.map(add, moves, updates), memory

    # How many is no part of the program: to compile it, take none.
    return jax.lax.fori_loop(0, steps, step, (moves, optimizer.init(moves)))[0]
