"""How contours share out the scalp: tilings, and borders that none crosses."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..host import on_device
from .contour import ANGLES
from .cylinder import GeneralizedCylinder
from .ownership import rehouse_wisps
from .tree import HairTree, ScalpContour
from .vector import TINY

# A cell reaches this far at least, if its centre lies on the border of the patch.
LEAST = 1e-3
# Parts of the angle between two spokes in which a border is looked for.
PARTS = 9
# Centres are filled up to a multiple of this, so that fewer programs are compiled.
FULL = 16

Border = Float[Array | np.ndarray, "points 2"]


def spokes() -> Float[np.ndarray, "32 2"]:
    """Return the 32 directions of a contour in scalp space."""
    angle = np.arange(ANGLES) * (2.0 * np.pi / ANGLES)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def cell_reach(
    centres: Float[np.ndarray, "clusters 2"], borders: Sequence[Border] = ()
) -> Float[np.ndarray, "clusters 32"]:
    """Return how far the Voronoi cells of centres reach along the spokes.

    Cells end at the border of the patch. Two centres with a border between them have
    no influence on each other.

    Args:
        centres: The centres, in scalp space.
        borders: Polylines in scalp space.
    """
    directions = spokes()
    apart = centres[None] - centres[:, None]
    toward = np.einsum("ijk,ak->ija", apart, directions)
    square = (apart**2).sum(-1)[..., None]
    # Along a spoke, the cell ends at the first bisector with another centre.
    free = toward <= 1e-9
    if len(borders):
        free |= parted(centres, borders)[..., None]
    bisector = np.where(free, np.inf, square / np.maximum(2.0 * toward, 1e-9))
    wall = np.where(directions > 0.0, 1.0, 0.0)[None] - centres[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        border = np.where(np.abs(directions) > 1e-9, wall / directions, np.inf)
    return np.minimum(bisector.min(axis=1), np.maximum(border.min(axis=2), LEAST))


def parted(
    centres: Float[np.ndarray, "clusters 2"], borders: Sequence[Border]
) -> Bool[np.ndarray, "clusters clusters"]:
    """Return which pairs of centres have a border between them."""
    points = jnp.asarray(fill(centres))
    crossed = np.zeros((len(points), len(points)), bool)
    for border in borders:
        crossed |= np.asarray(sightlines(points, jnp.asarray(border, points.dtype)))
    return crossed[: len(centres), : len(centres)]


@jax.jit
def sightlines(
    points: Float[Array, "clusters 2"], border: Border
) -> Bool[Array, "clusters clusters"]:
    """Return which straight lines between points cross a border."""
    apart = points[None] - points[:, None]
    ray = jax.vmap(jax.vmap(first_crossing, (None, 0, None)), (0, 0, None))
    return ray(points, apart, border) <= 1.0


def fill(rows: Array | np.ndarray) -> np.ndarray:
    """Return rows, the first one repeated behind them up to a multiple of `FULL`."""
    rest = -len(rows) % FULL
    return np.concatenate([rows, np.repeat(np.asarray(rows)[:1], rest, axis=0)])


def star_contours(
    centres: Float[Array | np.ndarray, "clusters 2"],
    reach: Float[np.ndarray, "clusters 32"],
) -> ScalpContour:
    """Return stacked contours that reach so far from their centres along the spokes.

    The global radius is the mean of the reach.
    """
    radius = reach.mean(axis=1)
    centre = on_device(centres)
    return jax.vmap(ScalpContour)(
        centre,
        on_device(radius, centre.dtype),
        on_device(reach - radius[:, None], centre.dtype),
    )


def tile_contours(
    centres: Float[Array | np.ndarray, "clusters 2"],
    overlap: float = 1.0,
    borders: Sequence[Border] = (),
) -> ScalpContour:
    """Return contours that tile the scalp with the Voronoi cells of their centres.

    Cells are known along 32 spokes only, so their corners are rounded or sharpened
    a little; an `overlap` of 1.1 leaves no gap, and where contours overlap the closest
    centre owns a root, which is the Voronoi diagram again [Kim02, section 4.5.1].

    Args:
        centres: The centres, in scalp space.
        overlap: What the cells are scaled by.
        borders: Polylines that no contour crosses, as `cut_contour` has it.
    """
    reach = overlap * cell_reach(np.asarray(centres, np.float64), borders)
    return cut_contours(star_contours(centres, reach), borders)


@functools.partial(jax.jit, static_argnames="turns")
def contour_outline(contour: ScalpContour, turns: int = 129) -> Float[Array, "turns 2"]:
    """Return a scalp contour as a closed polyline in scalp space.

    Args:
        contour: One contour; where it has no radius the outline is its centre.
        turns: Number of points, of which the last is the first again.
    """
    dtype = contour.offset.dtype
    position = jnp.linspace(0.0, ANGLES, turns, dtype=dtype)
    reach = contour.radius + contour.offset
    reach = jnp.append(reach, reach[0])
    knots = jnp.arange(ANGLES + 1, dtype=dtype)
    radius = jnp.maximum(jnp.interp(position, knots, reach), 0.0)
    angle = position * (2.0 * jnp.pi / ANGLES)
    spoke = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
    return contour.centre[None] + radius[:, None] * spoke


def first_crossing(
    start: Float[Array, " 2"], direction: Float[Array, " 2"], border: Border
) -> Float[Array, ""]:
    """Return how far a ray runs until it first meets a polyline, infinite if never.

    Args:
        start: Where it starts.
        direction: Where it runs; the distance is in its lengths.
        border: Points of the polyline, 2 or more.

    Raises:
        ValueError: If the border has fewer than two points.
    """
    if border.shape[0] < 2:
        raise ValueError(
            f"a border needs at least 2 points, got {border.shape[0]}; give the ends "
            "of a straight parting."
        )
    p = jnp.asarray(border, start.dtype)
    along, rest = p[1:] - p[:-1], p[:-1] - start[None]
    across = direction[0] * along[:, 1] - direction[1] * along[:, 0]
    meets = jnp.abs(across) > TINY
    safe = jnp.where(meets, across, 1.0)
    distance = (rest[:, 0] * along[:, 1] - rest[:, 1] * along[:, 0]) / safe
    share = (rest[:, 0] * direction[1] - rest[:, 1] * direction[0]) / safe
    # No ray may slip through between two pieces of the polyline.
    slack = 8.0 * jnp.finfo(start.dtype).eps
    meets &= (distance >= 0.0) & (share >= -slack) & (share <= 1.0 + slack)
    return jnp.min(jnp.where(meets, distance, jnp.inf))


def cut_reach(contour: ScalpContour, border: Border) -> Float[Array, " 32"]:
    r"""Return the share of a contour's radius that a border leaves, per spoke.

    Where a spoke ends at the border, the contour would still cross it between two
    spokes: the radius is linear in the angle there, and the border $p / \cos \psi$ of a
    straight parting is below its chords. So a border is looked for in nine parts
    of each such angle, and both spokes are shortened to the line below all that is
    found which is the highest in the middle.
    """
    dtype = contour.offset.dtype
    reach = contour.radius + contour.offset
    share = jnp.arange(PARTS + 1, dtype=dtype) / PARTS
    sector = jnp.arange(ANGLES, dtype=dtype)
    angle = (sector[:, None] + share[None]) * (2.0 * jnp.pi / ANGLES)
    direction = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    crossing = jax.vmap(jax.vmap(first_crossing, (None, 0, None)), (None, 0, None))
    free = crossing(contour.centre, direction, border)
    after = jnp.roll(reach, -1)
    full = reach[:, None] + share[None] * (after - reach)[:, None]
    untouched = jnp.all(free >= full, axis=1)
    line = jax.vmap(line_below, (None, 0))(share, jnp.minimum(free, full))
    first = jnp.where(untouched, reach, line[:, 0])
    last = jnp.where(untouched, after, line[:, 1])
    left = jnp.minimum(first, jnp.roll(last, 1))
    some = reach > TINY
    return jnp.where(some, left / jnp.where(some, reach, 1.0), 1.0)


def line_below(
    at: Float[Array, " samples"], values: Float[Array, " samples"]
) -> Float[Array, " 2"]:
    """Return the ends, at 0 and 1, of the highest line below samples.

    Highest in the middle, that is: there it touches the samples' lower convex hull.
    Ends are not negative.
    """
    half = at.shape[0] // 2
    x0, x1 = at[:half, None], at[None, half:]
    y0, y1 = values[:half, None], values[None, half:]
    slope = (y1 - y0) / (x1 - x0)
    start = y0 - slope * x0
    lowest = jnp.argmin(start + 0.5 * slope)
    first, slope = start.reshape(-1)[lowest], slope.reshape(-1)[lowest]
    last = first + slope
    # An end below 0 is lifted to 0, and the other one pays for it.
    last_alone = jnp.min(values[1:] / at[1:])
    first_alone = jnp.min(values[:-1] / (1.0 - at[:-1]))
    low, high = first < 0.0, last < 0.0
    return jnp.maximum(
        jnp.stack(
            [
                jnp.where(high, jnp.minimum(first, first_alone), first),
                jnp.where(low, jnp.minimum(last, last_alone), last),
            ]
        ),
        0.0,
    )


def cut_contour(contour: ScalpContour, border: Border) -> ScalpContour:
    r"""Return a contour cut at a border, such as a parting, in scalp space.

    What lies behind the border, seen from the contour's centre, is no longer inside:
    the means to the user-controlled borders of figure 4-14b. A centre on the border
    keeps nothing.

    Between spokes the cut is safe as well, to the ninth part of their angle. A circle
    that reaches 3 times as far as a straight border is away crosses it by less than
    1/1000 of that distance and loses up to 1.3 % of its area before it; at 10 times
    these are 1/200 and 3.5 %. Around an end of a border it may come by 1/288 of a turn.

    Args:
        contour: One contour.
        border: Points of a polyline, 2 or more.

    Raises:
        ValueError: If the border has fewer than two points.
    """
    share = cut_reach(contour, border)
    scaled = scale_radius(contour.radius, contour.offset, share)
    return ScalpContour(contour.centre, *scaled)


class Star(NamedTuple):
    """The shape of a contour: its global radius, and its offsets from it."""

    radius: Float[Array, ""]
    offset: Float[Array, " 32"]


def scale_radius(
    radius: Float[Array, ""], offset: Float[Array, " 32"], share: Float[Array, " 32"]
) -> Star:
    """Return the shape of a contour that is scaled spoke by spoke."""
    size = radius * jnp.mean(share)
    return Star(size, (radius + offset) * share - size)


def scale_cylinder(
    cylinder: GeneralizedCylinder, share: Float[Array, " 32"]
) -> GeneralizedCylinder:
    """Return a cluster whose contours in the world are scaled spoke by spoke."""
    each = jax.vmap(scale_radius, (0, 0, None))
    star = each(cylinder.radius, cylinder.offset, share)
    return eqx.tree_at(lambda c: (c.radius, c.offset), cylinder, tuple(star))


def cut_contours(contours: ScalpContour, borders: Sequence[Border]) -> ScalpContour:
    """Return stacked contours cut at each of some borders by `cut_contour`."""
    for border in borders:
        contours = cut_all(contours, jnp.asarray(border, contours.radius.dtype))
    return contours


@jax.jit
def cut_all(contours: ScalpContour, border: Border) -> ScalpContour:
    """`cut_contour` of stacked contours."""
    return jax.vmap(cut_contour, (0, None))(contours, border)


class Clusters(NamedTuple):
    """Stacked clusters: their scalp contours, and their cylinders."""

    contour: ScalpContour
    cylinder: GeneralizedCylinder


def scale_clusters(
    contours: ScalpContour,
    cylinders: GeneralizedCylinder,
    share: Float[Array, "clusters 32"],
) -> Clusters:
    """Return stacked clusters scaled spoke by spoke, on the scalp and in the world.

    Both alike, so that along a spoke a root keeps its place in every cross-section.
    """
    star = jax.vmap(scale_radius)(contours.radius, contours.offset, share)
    scaled = eqx.tree_at(lambda c: (c.radius, c.offset), contours, tuple(star))
    return Clusters(scaled, jax.vmap(scale_cylinder)(cylinders, share))


@jax.jit
def cut_clusters(
    contours: ScalpContour, cylinders: GeneralizedCylinder, borders: Sequence[Border]
) -> Clusters:
    """`cut_contours`, and the contours in the world to the same shares."""
    for border in borders:
        share = jax.vmap(cut_reach, (0, None))(contours, border)
        contours, cylinders = scale_clusters(contours, cylinders, share)
    return Clusters(contours, cylinders)


def part_tree(
    tree: HairTree,
    borders: Sequence[Border],
    clusters: Sequence[int] | np.ndarray | None = None,
) -> HairTree:
    """Return the tree whose scalp contours end at borders, such as a parting.

    Contours in the world are cut to the same shares as those on the scalp, so a strand
    that keeps its owner keeps its way along a spoke, and nearly so between two.

    What a contour loses goes to others that contain it. A root cluster across the
    parting gives up the roots on the other side, which are bald if no other root
    cluster is there: `subdivide` it along the parting instead, which loses no root.
    Wisps that no leaf owns any more are dropped.

    Runs outside `jit`.

    Args:
        tree: The tree.
        borders: Polylines in scalp space, each of 2 points or more.
        clusters: The clusters that are cut; None for all.
    """
    chosen = np.arange(tree.count) if clusters is None else np.asarray(clusters, int)
    if not len(chosen) or not len(borders):
        return tree
    dtype = tree.scalp.control.dtype
    before = (tree.contour, tree.cylinder)
    some = jax.tree.map(lambda leaf: leaf[chosen], before)
    after = jax.tree.map(
        lambda leaf, new: leaf.at[chosen].set(new),
        before,
        tuple(cut_clusters(*some, [jnp.asarray(one, dtype) for one in borders])),
    )
    tree = eqx.tree_at(lambda t: (t.contour, t.cylinder), tree, after)
    return rehouse_wisps(tree)
