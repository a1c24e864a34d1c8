"""Strands grown from the scalp through the field of directions."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy import ndimage

from ..host import on_device
from ..model.vector import unit
from ..types import resample_paths
from .evidence import Field
from .grid import corners, trilinear, trilinear_many, uphill
from .hull import Hull
from .shorn import LENGTH

# Of the scalp's normal in a strand's first direction, against the flow's.
LIFT = 0.2
AT_ONCE = 512  # strands that are traced together
# A strand that has come no farther than this share of so many metres runs in circles,
# or, of more metres, about a bun: it then ends once round, as where it goes on it is
# as good as before, and no cluster follows strands that wind apart.
CIRCLE, WOUND, ROUND = 0.06, 0.12, 0.35
# Of the channels of `Space.lines`, which of them turn where the flow does.
BACKWARDS = np.array([1, 1, 1, 1, -1, -1, -1, 1, 1], np.float32)
NEVER = 2.0  # no cosine is as large
RIM = 0.015  # of curly hair, see `GrowConfig.rim`, in metres


@dataclasses.dataclass(frozen=True)
class GrowConfig:
    """How strands grow. Metres."""

    step: float = 0.003
    longest: float = 0.6
    """No strand grows longer than this."""
    clearance: float = 0.0015
    """Strands keep so far from the skin."""
    steepest: float = 0.6
    """Cosine to the hull's normal from which leaving it is an end, no grazing."""
    steepest_stubble: float = 0.3
    """The same, where stubble ends."""
    shorn: float = LENGTH
    """How far a strand runs through shorn hair."""
    stiffness: float = 0.3
    """Share of the last direction that a strand keeps where the field is sure."""
    spread: float = 0.15
    """Share of the flow across the field that strands follow, to fill the hull."""
    rim: float = 0.0
    """Strands keep so far inside the hull, but not beyond halfway to the skin, and less
    where they meet it within 30 degrees of its normal."""


def steps_on(spacing: float, *, curly: bool = False) -> GrowConfig:
    """Return how strands grow on a grid of a spacing, in metres.

    Locks of curly hair keep clear of the hull, which the turns of the outermost make,
    and where only the sides of turns show. They slide along that rim, and end where
    they meet the hull head on.
    """
    config = GrowConfig(step=max(GrowConfig.step, 0.8 * spacing))
    return dataclasses.replace(config, steepest=NEVER, rim=RIM) if curly else config


class Space(NamedTuple):
    """What strands ask of every place on their way, on the device; see `space_of`.

    Attributes:
        channels: Distance to the hull's border and its uphill, and to the head and its.
        lines: Direction of the field, its anisotropy, the flow, and whether there are
            stubble and shorn hair.
        origin: Of the grid, in metres.
        spacing: Of the grid, in metres.
    """

    channels: Float[Array, "x y z 8"]
    lines: Float[Array, "x y z 9"]
    origin: Float[Array, " 3"]
    spacing: Float[Array, ""]

    def backwards(self) -> "Space":
        """Return the space where strands grow against the flow."""
        return self._replace(lines=on_device(np.asarray(self.lines) * BACKWARDS))


class _State(NamedTuple):
    point: Float[Array, "strands 3"]
    heading: Float[Array, "strands 3"]
    alive: Bool[Array, " strands"]
    gone: Float[Array, " strands"]


def space_of(hull: Hull, field: Field, flow: Float[np.ndarray, "x y z 3"]) -> Space:
    """Return the space in which strands grow.

    Args:
        hull: Where hair can be.
        field: Directions without sign.
        flow: Unit direction of growth in every voxel, from `flow.hair_flow`.
    """
    # Smoothed, or the steps of the voxels would turn up as steps of the strands.
    distance = ndimage.gaussian_filter(hull.distance, 0.7)
    head = ndimage.gaussian_filter(hull.head, 0.7)
    channels = np.concatenate(
        [distance[..., None], uphill(distance), head[..., None], uphill(head)], axis=-1
    )
    nowhere, ends = np.zeros(hull.grid.shape), (field.stubble, field.shorn)
    ends = np.stack([nowhere if one is None else one for one in ends], axis=-1)
    parts = [field.direction, field.anisotropy[..., None], flow, ends]
    lines = np.concatenate(parts, axis=-1)
    given = channels, lines, hull.grid.origin, hull.grid.spacing
    return Space(*(on_device(one, jnp.float32) for one in given))


def grow(
    space: Space,
    roots: Float[np.ndarray, "strands 3"],
    normals: Float[np.ndarray, "strands 3"],
    knots: int,
    config: GrowConfig | None = None,
) -> Float[np.ndarray, "strands knots 3"]:
    """Return strands that start at the roots and follow the field to their tips.

    The field has no sign: a strand takes that of the flow, and ends where the flow
    comes towards it or leads it in circles. It slides along the hull, or along a rim
    within it, where it leaves it at a low angle, and ends where it leaves it steeply.

    Args:
        space: Where hair can be, and how it runs there.
        roots: Where strands start, in metres.
        normals: Unit normals of the scalp there.
        knots: Points a strand, at equal distances along it.
        config: How strands grow.

    Returns:
        The strands, root first, in metres.
    """
    config = config or GrowConfig()
    # So many at once, or each number of strands would be compiled anew.
    spare = [(0, -len(roots) % AT_ONCE), (0, 0)]
    starts, outwards = (
        np.pad(one.astype(np.float32), spare, mode="edge").reshape(-1, AT_ONCE, 3)
        for one in (roots, normals)
    )
    paths = [
        np.asarray(trace(space, on_device(start), on_device(outward), config))
        for start, outward in zip(starts, outwards, strict=True)
    ]
    path = np.concatenate(paths, axis=1)[:, : len(roots)].astype(np.float64)
    points = uncircled(np.concatenate([roots[None], path]), config.step)
    return resample_paths(points.transpose(1, 0, 2), knots)


def uncircled(
    path: Float[np.ndarray, "steps strands 3"], step: float
) -> Float[np.ndarray, "steps strands 3"]:
    """Return paths that end where they begin to run in circles, or once round a bun.

    A field has no end in the middle of a whirl, as where a bun is wound up: strands
    would fill it, until they are as long as any may be, where no hair is.

    Args:
        path: Where each strand is at each step, in metres; after its tip it stays.
        step: How far a strand goes in a step, in metres.
    """
    once = _circling(path, step, WOUND) + round(WOUND / step)
    last = np.minimum(_circling(path, step, CIRCLE), once)
    kept = np.minimum(np.arange(len(path))[:, None], last)
    return np.take_along_axis(path, kept[..., None], axis=0)


def _circling(
    path: Float[np.ndarray, "steps strands 3"], step: float, length: float
) -> Int[np.ndarray, " strands"]:
    """Return from where on each path comes nowhere in such a length; its end if never.

    Args:
        path: Where each strand is at each step, in metres.
        step: How far a strand goes in a step, in metres.
        length: In metres.
    """
    lag = round(length / step)
    if lag >= len(path):
        return np.full(path.shape[1], len(path) - 1)
    goes = (path[lag:] != path[lag - 1 : -1]).any(axis=2)
    gone = np.linalg.norm(path[lag:] - path[:-lag], axis=2)
    circles = goes & (gone < ROUND * length)
    return np.where(circles.any(axis=0), circles.argmax(axis=0), len(path) - 1)


@jax.jit(static_argnames="config")
def trace(
    space: Space,
    roots: Float[Array, "strands 3"],
    normals: Float[Array, "strands 3"],
    config: GrowConfig,
) -> Float[Array, "steps strands 3"]:
    """Return the path of every strand; after its tip a strand repeats it."""
    channels, lines, origin, spacing = space
    stubble = min(config.steepest, config.steepest_stubble)

    def heading(point, last):
        index, weight = corners(lines.shape[:3], origin, spacing, point)
        near = lines[index[:, 0], index[:, 1], index[:, 2]]
        sign = jnp.where(jnp.sum(near[:, :3] * near[:, 4:7], axis=1) < 0, -1.0, 1.0)
        sure = weight * (near[:, 3] + 0.02)
        mean = (sure * sign) @ near[:, :3] / jnp.maximum(jnp.sum(sure), 1e-6)
        ahead, flow = unit(mean, last), weight @ near[:, 4:7]
        across = flow - (flow @ ahead) * ahead
        keep = config.stiffness + 0.5 * (1.0 - jnp.sum(sure))
        steepest = jnp.where(weight @ near[:, 7] > 0.5, stubble, config.steepest)
        ahead = unit(mean + config.spread * across + keep * last, last)
        return ahead, steepest, weight @ near[:, 8]

    def one(rooted, point, last, alive, gone):
        ahead, steepest, shorn = heading(point, last)
        goal = point + config.step * ahead
        here = trilinear(channels, origin, spacing, goal)
        goal = goal + jnp.maximum(config.clearance - here[4], 0.0) * here[5:8]
        here = trilinear(channels, origin, spacing, goal)
        out = ahead @ here[1:4]
        # No rim where a lock meets the hull head on: there its hair ends.
        rim = jnp.clip(0.5 * here[4], 0.0, config.rim)
        rim = rim * jnp.minimum(2.0 * jnp.sqrt(1.0 - jnp.clip(out, 0.0, 1.0) ** 2), 1.0)
        leaves = here[0] + rim > 0.0
        ends = leaves & (out > steepest)
        goal = goal - jnp.where(leaves, here[0] + rim, 0.0) * here[1:4]
        move = goal - point
        ends = ends | (move @ last < 0.3 * config.step)
        gone = gone + jnp.maximum(shorn, rooted) * config.step
        ends = ends | (gone > config.shorn)
        alive = alive & ~ends
        return _State(
            jnp.where(alive, goal, point),
            jnp.where(alive, unit(move, last), last),
            alive,
            gone,
        )

    def advance(state, _):
        state = jax.vmap(one)(rooted, *state)
        return state, state.point

    start = roots + config.clearance * normals
    flow = trilinear_many(lines[..., 4:7], origin, spacing, start)
    first = jax.vmap(unit)(flow + LIFT * normals, normals)
    rooted = trilinear_many(lines[..., 8:], origin, spacing, start)[:, 0]
    state = _State(start, first, jnp.ones(len(roots), bool), 0.0 * rooted)
    steps = int(config.longest / config.step)
    _, path = jax.lax.scan(advance, state, None, length=steps)
    return jnp.concatenate([start[None], path])
