"""A hairstyle on another head: a smooth warp of space carries the tree."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, ScalarLike
from scipy.interpolate import RBFInterpolator
from scipy.spatial import KDTree

from .collide import DistanceField, push_out_tree
from .curve import EXACT, arc_length, catmull_rom_weights
from .cylinder import GeneralizedCylinder
from .scalp import Scalp, normals_on, points_on
from .section import carry
from .tree import HairTree
from .trim import dense_count, end_at, grown_end
from .vector import TINY

# Points a side of the grid on the scalp that the warp is fitted to.
SIDE = 17
# How far above the scalp it is fitted as well, as shares of the scalp's size.
LIFTS = (0.0, 0.15, 0.4)
# Points that are closer than this share of the scalp's size count as one.
APART = 1e-3
# Radius of the sphere on which the warp is affine, and how near to its points no other
# may be, as multiples of the scalp's size; and how many points it has.
FAR, FREE, ANCHORS = 1.1, 0.25, 64
# Step of the differences for the warp's derivative, as a share of the scalp's size.
STEP = 1e-3


class Correspondences(NamedTuple):
    """Points about one head and what they become about another one, in metres.

    Attributes:
        before: The points.
        after: The same points about the other head.
    """

    before: Float[np.ndarray, "points 3"]
    after: Float[np.ndarray, "points 3"]


class Warp(NamedTuple):
    """A smooth map of the space about one head to that about another one.

    Attributes:
        displacement: What is added to points, as radial basis functions.
        step: Step of the differences for the map's derivative, in metres.
    """

    displacement: RBFInterpolator
    step: float


def transfer(
    tree: HairTree,
    scalp: Scalp,
    *,
    from_points: Float[Array | np.ndarray, "points 3"] | None = None,
    to_points: Float[Array | np.ndarray, "others 3"] | None = None,
    field: DistanceField | None = None,
    gap: ScalarLike = 0.002,
    keep_lengths: bool = False,
) -> HairTree:
    """Return the tree on another head and scalp.

    What the thesis sketches in section 4.10: the scalp says where hair goes, radial
    basis functions how. Contours keep their place (u, v) in scalp space. The space
    about the head is warped (see `head_warp`), and skeletons with it. Cross-sections
    are mapped by the warp's derivative: what it stretches evenly goes to the contours,
    the rest to scale, twist and shear. Roots are set onto the new scalp exactly; what
    that moves fades out towards the tips. Wisps grow with their cluster.

    A head that is moved or scaled as a whole takes its hair with it, unchanged. Runs
    outside `jit`.

    Args:
        tree: The tree.
        scalp: The scalp of the other head, whose u and v run as those of the tree's;
            `align_scalp` makes it so.
        from_points: More points that are known on both heads, of the face and the
            neck, say; these are on the tree's head.
        to_points: The same points on the other head.
        field: The other head; with it, skeletons are kept out of it (4-9).
        gap: Least distance of control points above the skin of `field`, in metres.
        keep_lengths: Keep skeletons as long as they are, in metres: those that the warp
            makes longer are cut, and shorter ones go on straight.

    Raises:
        ValueError: If the points on both heads are not equally many.
    """
    pairs = correspondences(tree.scalp, scalp, from_points, to_points)
    warp = head_warp(pairs, scalp_size(tree.scalp))
    before = tree.cylinder.skeleton
    dtype, shape = before.dtype, before.shape
    flat = np.asarray(before, np.float64).reshape(-1, 3)
    derivative = warp_derivatives(warp, flat)
    stretch = np.cbrt(np.abs(np.linalg.det(derivative)))
    centre = tree.contour.centre
    foot = warp_points(warp, np.asarray(points_on(tree.scalp, centre), np.float64))
    moved = Moved(
        jnp.asarray(warp_points(warp, flat).reshape(shape), dtype),
        jnp.asarray((derivative / stretch[:, None, None]).reshape(*shape, 3), dtype),
        jnp.asarray(stretch.reshape(shape[:2]), dtype),
        jnp.asarray(np.asarray(points_on(scalp, centre), np.float64) - foot, dtype),
    )
    cylinder = place_all(tree.cylinder, moved)
    wisps = tree.wisps
    if wisps is not None:
        offset = wisps.offset * moved.stretch[wisps.owner][:, :, None]
        wisps = eqx.tree_at(lambda w: w.offset, wisps, offset)
    placed = dataclasses.replace(tree, scalp=scalp, cylinder=cylinder, wisps=wisps)
    if keep_lengths:
        end = ends_at_length(cylinder, curve_lengths(before))
        placed = end_at(placed, np.arange(tree.count), end)
    return placed if field is None else push_out_tree(field, placed, gap)


def align_scalp(scalp: Scalp, like: Scalp) -> Scalp:
    """Return a scalp, the same surface, whose u and v run as another one's.

    Of the eight ways to name the corners of a patch it is the one in which control
    points of both scalps are closest, after their middles and sizes are made equal. The
    two heads have to look the same way.

    Args:
        scalp: The scalp.
        like: The other scalp.
    """

    def centred(control: Float[np.ndarray, "13 13 3"]):
        rest = control - control.mean(axis=(0, 1))
        return rest / np.sqrt((rest * rest).sum())

    given = np.asarray(scalp.control)
    goal = centred(np.asarray(like.control))
    ways = [
        np.rot90(one, turns)
        for one in (given, np.swapaxes(given, 0, 1))
        for turns in range(4)
    ]
    apart = [((centred(way) - goal) ** 2).sum() for way in ways]
    return Scalp(jnp.asarray(ways[int(np.argmin(apart))]))


def correspondences(
    before: Scalp,
    after: Scalp,
    from_points: Float[Array | np.ndarray, "points 3"] | None = None,
    to_points: Float[Array | np.ndarray, "others 3"] | None = None,
) -> Correspondences:
    """Return points about two heads that belong together.

    They are points of both scalps at the same (u, v), the same points lifted along the
    normals as far as the size of each scalp says, and those that are given. Where
    points about the first head coincide, as where a patch is pinched, one is kept.

    Args:
        before: The scalp of the first head.
        after: The scalp of the second one.
        from_points: More points on the first head.
        to_points: The same points on the second one.

    Raises:
        ValueError: If the given points are not equally many.
    """
    if (from_points is None) != (to_points is None):
        raise ValueError("points on one head alone say nothing; give those on both.")
    if from_points is None or to_points is None:
        from_points = to_points = np.zeros((0, 3))
    if len(from_points) != len(to_points):
        raise ValueError(
            f"{len(from_points)} points on one head and {len(to_points)} on the other "
            "do not belong together; give equally many, in the same order."
        )
    side = np.linspace(0.0, 1.0, SIDE)
    uv = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)
    start, end = lifted(before, uv), lifted(after, uv)
    start = np.concatenate([start, np.asarray(from_points, np.float64)])
    end = np.concatenate([end, np.asarray(to_points, np.float64)])
    close = KDTree(start).query_pairs(APART * scalp_size(before), output_type="ndarray")
    kept = np.setdiff1d(np.arange(len(start)), close.max(axis=1, initial=-1))
    return Correspondences(start[kept], end[kept])


def lifted(
    scalp: Scalp, uv: Float[np.ndarray, "points 2"]
) -> Float[np.ndarray, "lifted 3"]:
    """Return points of a scalp at all lifts, one lift after the other."""
    at = jnp.asarray(uv, scalp.control.dtype)
    foot = np.asarray(points_on(scalp, at), np.float64)
    normal = np.asarray(normals_on(scalp, at), np.float64)
    heights = scalp_size(scalp) * np.array(LIFTS)
    return (foot[None] + heights[:, None, None] * normal[None]).reshape(-1, 3)


def scalp_size(scalp: Scalp) -> float:
    """Return the square root of the area of a scalp, in metres."""
    p = np.asarray(scalp.control, np.float64)
    area = np.cross(p[1:, 1:] - p[:-1, :-1], p[1:, :-1] - p[:-1, 1:])
    return float(np.sqrt(0.5 * np.linalg.norm(area, axis=-1).sum()))


def head_warp(pairs: Correspondences, size: float) -> Warp:
    """Return the smooth warp that takes points about one head to those about another.

    The displacement is an affine function and thin plate splines [Kim02, section
    4.10]. A head that is moved, scaled or stretched as a whole needs no splines.
    Splines alone would run wild where long hair hangs, away from all points. So on a
    sphere around the head, where no point is near, the warp is held to the affine map
    that fits all points best.

    Args:
        pairs: Points that belong together; at least 4, not in one plane.
        size: Size of the first scalp, in metres.
    """
    middle = pairs.before.mean(axis=0)

    def with_ones(p: Float[np.ndarray, "points 3"]):
        return np.concatenate([p - middle, np.ones((len(p), 1))], axis=1)

    move = pairs.after - pairs.before
    affine = np.linalg.lstsq(with_ones(pairs.before), move, rcond=None)[0]
    around = middle + FAR * size * sphere()
    around = around[KDTree(pairs.before).query(around)[0] > FREE * size]
    displacement = RBFInterpolator(
        np.concatenate([pairs.before, around]),
        np.concatenate([move, with_ones(around) @ affine]),
        kernel="thin_plate_spline",
        degree=1,
    )
    return Warp(displacement, STEP * size)


def sphere() -> Float[np.ndarray, "points 3"]:
    """Return points spread evenly over the unit sphere, on a spiral."""
    i = np.arange(ANCHORS) + 0.5
    height, azimuth = 1.0 - 2.0 * i / ANCHORS, np.pi * (1.0 + np.sqrt(5.0)) * i
    level = np.sqrt(1.0 - height * height)
    return np.stack([level * np.cos(azimuth), height, level * np.sin(azimuth)], axis=1)


def warp_points(
    warp: Warp, p: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, "points 3"]:
    """Return warped points, in metres."""
    return p + warp.displacement(p)


def warp_derivatives(
    warp: Warp, p: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, "points 3 3"]:
    """Return the warp's derivatives at points, by central differences."""
    steps = warp.step * np.eye(3)
    ahead, behind = (
        warp.displacement((p[None] + sign * steps[:, None]).reshape(-1, 3))
        for sign in (1.0, -1.0)
    )
    slope = (ahead - behind).reshape(3, -1, 3) / (2.0 * warp.step)
    return np.eye(3)[None] + np.transpose(slope, (1, 2, 0))


class Moved(NamedTuple):
    """What the warp does to stacked clusters.

    Attributes:
        skeleton: Their warped control points.
        linear: The warp's derivative there, without its stretch.
        stretch: By how much it stretches lengths there, all directions alike.
        missing: From each warped root to where it is on the scalp.
    """

    skeleton: Float[Array, "clusters knots 3"]
    linear: Float[Array, "clusters knots 3 3"]
    stretch: Float[Array, "clusters knots"]
    missing: Float[Array, "clusters 3"]


@jax.jit
def place_all(cylinder: GeneralizedCylinder, moved: Moved) -> GeneralizedCylinder:
    """Return stacked cylinders moved by the warp and set on the scalp."""

    def place(one: GeneralizedCylinder, moved: Moved) -> GeneralizedCylinder:
        skeleton, linear, stretch, missing = moved
        fade = jnp.linspace(1.0, 0.0, stretch.shape[0], dtype=stretch.dtype)
        placed = carry(one, skeleton + fade[:, None] * missing[None], linear)
        radius, offset = one.radius * stretch, one.offset * stretch[:, None]
        return dataclasses.replace(placed, radius=radius, offset=offset)

    return jax.vmap(place)(cylinder, moved)


def curve_length(skeleton: Float[Array, "knots 3"]) -> Float[Array, ""]:
    """Return the length of a skeleton's curve, in metres."""
    knots = skeleton.shape[0]
    t = jnp.linspace(0.0, 1.0, dense_count(skeleton), dtype=skeleton.dtype)
    weights = catmull_rom_weights(knots, t)
    return arc_length(jnp.matmul(weights, skeleton, precision=EXACT))[-1]


curve_lengths = jax.jit(jax.vmap(curve_length))


@jax.jit
def ends_at_length(
    cylinder: GeneralizedCylinder, length: Float[Array, " clusters"]
) -> Float[Array, " clusters"]:
    """Return where stacked clusters have to end to have given lengths."""
    own = jax.vmap(curve_length)(cylinder.skeleton)
    some = own > TINY
    factor = jnp.where(some, length / jnp.where(some, own, 1.0), 1.0)
    return jax.vmap(grown_end)(cylinder, factor)
