"""Tied hair: ponytail, pigtails, braid and bun."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ...model import HairTree, Scalp
from ...model.bind import Bound, update_points
from ...model.cylinder import GeneralizedCylinder
from ...model.reflect import mirror
from ...model.section import on_skeleton
from ...model.tree import ScalpContour, graft, plant, take
from ...render.raster import unit
from ..guides import DOWN, TIE, keep_off, resampled
from ..head import CRANIUM
from .base import Guides, Lay, lay, ramp, root_clusters, roots_of, settle, split, widen
from .guides import Points, length_line, scalp_line

OVER = 60  # steps of the way over the head
SIDE_TIE = np.array([0.088, 0.020, -0.075])


class Tie(NamedTuple):
    """Where hair is tied.

    Attributes:
        p: The place.
        out: The direction in which the tail leaves, a unit vector.
        size: Radius of the tied hair.
    """

    p: Float[np.ndarray, " 3"]
    out: Float[np.ndarray, " 3"]
    size: float = 0.011


def to_tie(roots: Points, tie: Tie) -> Float[np.ndarray, "clusters 2"]:
    """Return where in the tie's cross-section each root's hair goes through.

    Side and up, seen along the tail: what comes from above goes through above.
    """
    side = unit(np.cross(tie.out, [0.0, 1.0, 0.0]))
    up = np.cross(side, tie.out)
    rest = roots - tie.p
    flat = np.stack([rest @ side, rest @ up], 1)
    far = np.linalg.norm(flat, axis=1, keepdims=True)
    return tie.size * np.tanh(far / 0.1) * flat / np.maximum(far, 1e-9)


def over_head(roots: Points, gate: Points) -> Float[np.ndarray, "clusters steps 3"]:
    """Return curves from roots over the head to their places in a tie."""
    first, last = roots - CRANIUM, gate - CRANIUM
    angle = np.arccos(np.clip((unit(first) * unit(last)).sum(1), -1.0, 1.0))
    s = np.linspace(0.0, 1.0, OVER)[:, None, None]
    angle = np.maximum(angle, 1e-3)[:, None]
    ray = np.sin((1.0 - s) * angle) * unit(first) + np.sin(s * angle) * unit(last)
    far, near = (np.linalg.norm(x, axis=1, keepdims=True) for x in (first, last))
    p = CRANIUM + ((1.0 - s) * far + s * near) * ray / np.sin(angle)
    way = np.linalg.norm(gate - roots, axis=1)[:, None]
    off = 0.003 + 0.022 * np.clip(way, 0.0, 0.2)
    off = off * ramp(s * way, 0.0, 0.05) * ramp((1.0 - s) * way, 0.0, 0.05)
    p = keep_off(p.reshape(-1, 3), off.reshape(-1, 1)).reshape(p.shape)
    return np.swapaxes(p, 0, 1)


def hang(tie: Tie, length: float, stiff: float = 0.17) -> Points:
    """Return the middle of a tail that leaves the tie and falls."""
    heading, path = tie.out, [tie.p]
    for _ in range(int(length / 0.004)):
        heading = unit(heading + stiff * DOWN)
        path.append(path[-1] + 0.004 * heading)
    return np.array(path)


def along_axis(
    axis: Points, side: Points, offset: Float[np.ndarray, "clusters 2"], spread
) -> Float[np.ndarray, "clusters points 3"]:
    """Return curves that run beside an axis.

    Args:
        axis: Points of it.
        side: At each, the direction of the first offset.
        offset: Of each curve: to the side, and across it.
        spread: What offsets are multiplied by, at each point.
    """
    way = unit(np.gradient(axis, axis=0))
    side = unit(side - (side * way).sum(1)[:, None] * way)
    up = np.cross(side, way)
    by = np.asarray(spread)[None, :, None] * offset[:, None]
    return axis[None] + by[..., :1] * side[None] + by[..., 1:] * up[None]


def gathered(
    tree: HairTree, tie: Tie, tails: Float[np.ndarray, "clusters points 3"], tail=0.35
) -> HairTree:
    """Return a tree of root clusters that run to a tie and on along tails.

    Args:
        tree: The tree.
        tie: The tie.
        tails: From the tie on; the first point of each is its place in the tie.
        tail: Share of their width that clusters have behind the tie.
    """
    knots = tree.cylinder.skeleton.shape[1]
    roots = roots_of(tree)
    over = over_head(roots, tails[:, 0])
    guides = resampled(list(np.concatenate([over, tails[:, 1:]], 1)), knots)
    far = np.linalg.norm(guides - tie.p, axis=2)
    step = np.linalg.norm(np.diff(over, axis=1), axis=2).sum(1)
    whole = step + np.linalg.norm(np.diff(tails, axis=1), axis=2).sum(1)
    at = np.linspace(0.0, 1.0, knots)[None] * whole[:, None] - step[:, None]
    before = 0.2 + 1.0 * ramp(far, 0.01, 0.08)
    behind = 0.2 + (tail - 0.2) * ramp(at, 0.0, 0.06)
    return widen(lay(tree, guides, Lay(0.3, 1.0)), np.where(at < 0.0, before, behind))


def ponytail(scalp: Scalp, seed: int) -> HairTree:
    """Return hair tied at the back of the head."""
    tree = root_clusters(scalp, 40, 40, seed)
    tie = Tie(TIE, unit(np.array([0.0, 0.25, -1.0])))
    return settle(split(tailed(tree, tie, 0.24), 6, seed))


def tailed(tree: HairTree, tie: Tie, length: float) -> HairTree:
    """Return a tree of root clusters tied to a tail that hangs."""
    axis = hang(tie, length)
    t = np.linspace(0.0, 1.0, len(axis))
    spread = 1.0 + 1.2 * ramp(t, 0.0, 0.3) - 1.1 * ramp(t, 0.55, 1.1)
    side = np.tile(unit(np.cross(tie.out, [0.0, 1.0, 0.0])), (len(axis), 1))
    tails = along_axis(axis, side, to_tie(roots_of(tree), tie), spread)
    return gathered(tree, tie, tails)


def pigtails(scalp: Scalp, seed: int) -> HairTree:
    """Return hair parted in the middle; the left is tied, the right mirrors it."""
    line = scalp_line(scalp, length_line(0.0, 90.0, 130.0))
    tree = root_clusters(scalp, 44, 40, seed, [line])
    tree = take(tree, roots_of(tree)[:, 0] > 0.0)
    tie = Tie(SIDE_TIE, unit(np.array([1.0, 0.1, -0.45])))
    tree = split(tailed(tree, tie, 0.20), 6, seed, [line])
    right = mirror(tree)
    above = [row if row < 0 else row + tree.count for row in tree.parent]
    both = graft(tree, right.contour, right.cylinder, right.length_variation, above)
    return settle(both)


def bun(scalp: Scalp, seed: int) -> HairTree:
    """Return hair tied high at the back, its tail wound up into a ball."""
    tree = root_clusters(scalp, 36, 64, seed)
    out = unit(np.array([0.0, 0.55, -1.0]))
    tie = Tie(np.array([0.0, 0.085, -0.112]), out)
    side = unit(np.cross(out, [0.0, 1.0, 0.0]))
    up = np.cross(side, out)
    rng = np.random.default_rng(seed)
    place = to_tie(roots_of(tree), tie)
    t = np.linspace(0.0, 1.0, 80)
    tails = []
    for x, y in place:
        start = np.arctan2(y, x) + 0.4 * rng.normal()
        angle = start + 2.0 * np.pi * 1.9 * t
        height = -0.95 + (1.55 + 0.3 * rng.uniform()) * t
        radius = 0.033 * (1.0 - 0.12 * rng.uniform())
        ring = radius * np.sqrt(np.clip(1.0 - height**2, 0.0, None))
        coil = ring[:, None] * (
            np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up
        )
        coil = coil + (0.026 + 0.030 * height)[:, None] * out + tie.p
        gate = tie.p + x * side + y * up
        grip = ramp(t, 0.0, 0.08)[:, None]
        tails.append((1.0 - grip) * gate + grip * coil)
    return settle(split(gathered(tree, tie, np.array(tails), 0.30), 5, seed))


def braid(scalp: Scalp, seed: int) -> HairTree:
    """Return hair gathered at the nape and braided: three locks bound to a tail."""
    tree = root_clusters(scalp, 42, 88, seed, vary=0.02)
    tie = Tie(np.array([0.0, 0.000, -0.112]), unit(np.array([0.0, -0.4, -1.0])), 0.014)
    axis = hang(tie, 0.30, 0.12)
    place = to_tie(roots_of(tree), tie)
    # Locks of a third of the clusters each: right, middle and left of the tail.
    rank = np.argsort(np.argsort(place[:, 0]))
    lock = rank * 3 // len(rank)
    tails = braided(scalp, axis, lock, place, seed)
    return settle(split(gathered(tree, tie, tails, 0.22), 4, seed))


def braided(scalp: Scalp, axis: Points, lock, place, seed: int) -> Guides:
    """Return how tails run along an axis in three locks that are plaited.

    Seen in the tail's contour, the locks run along one figure of eight, a third of a
    turn apart. The tail is a cluster, and the locks are what `update` makes of their
    places in it (section 4.6.1); each tail has its place in its lock.
    """
    knots = len(axis)
    t = np.linspace(0.0, 1.0, knots)
    contour = ScalpContour(jnp.array([0.5, 0.9]), jnp.asarray(0.02), jnp.zeros(32))
    size = 0.019 * (1.0 - 0.35 * t)
    tail = rope(scalp, contour, axis, size)
    rng = np.random.default_rng(seed)
    inner = 0.75 * np.sqrt(rng.uniform(size=len(place)))
    around = rng.uniform(0.0, 2.0 * np.pi, len(place))
    grip = ramp(t, 0.0, 0.08) * (1.0 - ramp(t, 0.84, 0.90))
    found = np.zeros((len(place), knots, 3))
    for number in range(3):
        phase = 2.0 * np.pi * (4.5 * t + number / 3.0)
        x, y = 0.55 * grip * np.sin(phase), 0.36 * grip * np.sin(2.0 * phase)
        path = places(tail, np.hypot(x, y), np.arctan2(y, x), t)
        thin = 0.25 + 0.75 * grip + 0.4 * ramp(t, 0.92, 1.0)
        one = rope(scalp, contour, path, 0.62 * size * thin)
        for row in np.flatnonzero(lock == number):
            r, theta = np.full(knots, inner[row]), np.full(knots, around[row])
            found[row] = places(one, r, theta, t)
    return found


def rope(
    scalp: Scalp, contour: ScalpContour, axis: Points, size
) -> GeneralizedCylinder:
    """Return a round cluster of given radii along an axis."""
    planted = plant(scalp, contour, 0.1, len(axis))
    dtype = planted.radius.dtype
    ones, zeros = jnp.ones((len(axis), 2), dtype), jnp.zeros(len(axis), dtype)
    first = planted.skeleton[0]
    round_one = GeneralizedCylinder(
        skeleton=first[None] + jnp.asarray(axis - axis[0], dtype),
        normal=jnp.array([1.0, 0.0, 0.0], dtype),
        radius=jnp.asarray(size, dtype),
        offset=jnp.zeros((len(axis), 32), dtype),
        scale=ones,
        twist=zeros,
        shear=zeros,
    )
    return jax.jit(on_skeleton)(round_one, jnp.asarray(axis, dtype))


def places(one: GeneralizedCylinder, r, theta, t) -> Points:
    """Return points of a cluster given by their places in it."""
    dtype = one.radius.dtype
    r, theta, t = (jnp.asarray(x, dtype) for x in (r, theta, t))
    bound = Bound(r, theta, t, jnp.zeros(len(t), bool))
    return np.asarray(update_points(one, bound))
