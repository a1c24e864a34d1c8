"""Subdivision: a cluster's hair shared out among children."""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, UInt32

from .contour import contour_radius
from .cylinder import GeneralizedCylinder, cylinder_frames
from .ownership import contains, find_owner, local_coordinates, rehouse_wisps
from .scalp import Scalp, scalp_point, scalp_tangents
from .section import carry
from .strand import strand_knots
from .tiling import (
    FULL,
    Border,
    cell_reach,
    contour_outline,
    cut_contours,
    fill,
    scale_cylinder,
    spokes,
    star_contours,
)
from .tree import HairTree, ScalpContour, children, cluster, graft
from .vector import TINY, norm, unit

# How far children's contours overlap; the thesis takes 1.3 to 1.5.
OVERLAP = 1.4
# Rounds of random points after which a contour counts as empty.
ROUNDS = 64
# Points of a spoke at which is asked who owns the root there.
ALONG = 24
# Steps of the relaxation, and the share of the contour that points keep to.
STEPS = 48
WITHIN = 0.98
# Pieces of each border, and of the contour's outline, that points keep away from.
PIECES = 64
# The pieces are filled up to a multiple of this, so that fewer programs are compiled.
WALLS = 256
# How much a child's contour may follow the scalp's metric, or fill its cell.
STRETCH = 2.0
# How much a cell is enlarged beside a border, for it is known along the spokes only.
CELL = 1.1


def subdivide(
    tree: HairTree,
    index: int,
    count: int,
    key: PRNGKeyArray | UInt32[Array, " 2"],
    *,
    overlap: float = OVERLAP,
    borders: Sequence[Border] = (),
) -> HairTree:
    r"""Return the tree in which a leaf cluster has children [Kim02, section 4.5].

    Their positions are random within what the cluster owns of its contour, and relaxed
    [Turk 1991]. Their contours are the cluster's, scaled by $\rho / \sqrt N$ on the
    scalp and by $1 / \sqrt N$ in the world; their skeletons are its strands. So the
    hair gathers about each child's skeleton, $\rho$ times as dense as before.

    No strand is lost: `find_owner` gives each root that the cluster contains to one of
    its children. Other roots change hands only if no leaf contains them, for they go
    to the closest leaf below a common ancestor.

    The parts are there for other ways of placing children: `scatter_centres`,
    `relax_centres`, `child_contours`, `tile_contours` and `subdivide_into`.

    Runs outside `jit`.

    Args:
        tree: The tree.
        index: The cluster, without children. It keeps its index; the children are the
            last clusters of the new tree.
        count: Number of children $N$.
        key: Randomness of the positions.
        overlap: $\rho$, 1.3 to 1.5 to cover the cluster's region.
        borders: Polylines in scalp space which no child crosses, such as a parting.

    Raises:
        ValueError: If there is no such cluster, it has children already, or there is
            no room for children on the scalp.
    """
    check_leaf(tree, index)
    region = owned_region(tree, index)
    centres = scatter_centres(tree.scalp, region, count, key)
    centres = relax_centres(tree.scalp, region, centres, borders)
    contour = cluster(tree.contour, index)
    contours = child_contours(tree.scalp, contour, centres, overlap, borders)
    return subdivide_into(tree, index, contours, overlap=overlap)


def subdivide_into(
    tree: HairTree, index: int, contours: ScalpContour, *, overlap: float = 1.0
) -> HairTree:
    r"""Return the tree in which a leaf cluster has children with given contours.

    A child's skeleton is the cluster's strand at the contour's centre (section 4.4),
    rooted on the scalp (4-8). Its contours in the world are the cluster's, spoke by
    spoke, in the proportion of the two scalp contours divided by $\rho$: $1 / \sqrt N$
    for contours of `child_contours`. Normal, scale, twist and shear are such that
    its cross-sections are those of the cluster, seen along the child's own tangents.
    So with $\rho = 1$ strands go on as before, if the cluster's hair is parallel.

    Length variation is inherited. Wisps move to the children that own their roots.

    Args:
        tree: The tree.
        index: The cluster, without children. It keeps its index; the children are the
            last clusters of the new tree.
        contours: Scalp contours of the children, stacked.
        overlap: $\rho$, how much wider the contours are than the children's share.

    Raises:
        ValueError: If there is no such cluster, or it has children already.
    """
    check_leaf(tree, index)
    contour, cylinder = cluster(tree.contour, index), cluster(tree.cylinder, index)
    count = len(contours.radius)
    filled = jax.tree.map(fill, contours)
    cylinders = child_cylinders(tree.scalp, contour, cylinder, filled, overlap)
    cylinders = jax.tree.map(lambda leaf: np.asarray(leaf)[:count], cylinders)
    variation = jnp.asarray(np.repeat(tree.length_variation[index], count))
    return rehouse_wisps(graft(tree, contours, cylinders, variation, [index] * count))


def check_leaf(tree: HairTree, index: int) -> None:
    """Raise a ValueError if a cluster cannot be subdivided."""
    if not 0 <= index < tree.count:
        raise ValueError(
            f"there is no cluster {index} to subdivide in a tree of {tree.count} "
            "clusters."
        )
    below = len(children(tree, index))
    if below:
        raise ValueError(
            f"cluster {index} has {below} children already; subdivide one of them, or "
            "remove them first by `drop_descendants`."
        )


@jax.jit
def child_cylinders(
    scalp: Scalp,
    contour: ScalpContour,
    cylinder: GeneralizedCylinder,
    contours: ScalpContour,
    overlap: Float[Array, ""] | float,
) -> GeneralizedCylinder:
    """Return the stacked cylinders of children with given scalp contours.

    Args:
        scalp: The scalp.
        contour: The scalp contour of the cluster above.
        cylinder: Its cylinder.
        contours: The scalp contours of the children, stacked.
        overlap: How much wider they are than the children's share.
    """
    frames = cylinder_frames(cylinder)
    knots = cylinder.skeleton.shape[0]
    dtype = cylinder.skeleton.dtype
    still = jnp.broadcast_to(jnp.eye(3, dtype=dtype), (knots, 3, 3))
    whole = contour.radius + contour.offset
    some = whole > TINY

    def child(own: ScalpContour) -> GeneralizedCylinder:
        full = jnp.ones((), dtype)
        skeleton = strand_knots(contour, cylinder, frames, own.centre, full)
        skeleton = skeleton.at[0].set(scalp_point(scalp, own.centre))
        reach = (own.radius + own.offset) / overlap
        share = jnp.where(some, reach / jnp.where(some, whole, 1.0), 0.0)
        return carry(scale_cylinder(cylinder, share), skeleton, still)

    return jax.vmap(child)(contours)


def child_contours(
    scalp: Scalp,
    contour: ScalpContour,
    centres: Float[Array | np.ndarray, "children 2"],
    overlap: float = OVERLAP,
    borders: Sequence[Border] = (),
) -> ScalpContour:
    r"""Return inherited contours: a cluster's, scaled by $\rho / \sqrt N$, stacked.

    The thesis has (u, v) for even. Here positions are even in metres, so contours must
    be: where the patch has less area to its (u, v), they are larger in (u, v). Each is
    scaled by a root of the area as well, such that together they cover what they
    would without. On an even patch nothing is added to the thesis's scale.

    A root that no child contains goes to the closest one, which may stand behind a
    border. So where there are borders, contours also fill what their Voronoi cells,
    among the children on their own side, have of the cluster's contour.

    Args:
        scalp: The scalp.
        contour: The scalp contour of the cluster above.
        centres: Where they shall stand, in scalp space.
        overlap: $\rho$.
        borders: Polylines in scalp space at which they end.
    """
    count = len(centres)
    area = np.asarray(scalp_area(scalp, jnp.asarray(fill(centres))))[:count]
    share = 1.0 / np.maximum(area, TINY)
    metric = np.clip(np.sqrt(share / share.mean()), 1.0 / STRETCH, STRETCH)
    scale = overlap / np.sqrt(count) * metric
    reach = scale[:, None] * np.asarray(contour.radius + contour.offset)[None]
    if len(borders):
        cells = CELL * cell_reach(np.asarray(centres, np.float64), borders)
        outline = contour_outline(contour)
        within = cut_contours(star_contours(centres, cells), [outline])
        cells = np.asarray(within.radius[:, None] + within.offset)
        reach = np.clip(cells, reach, STRETCH * reach)
    contours = star_contours(centres, reach)
    return cut_contours(contours, borders)


@jax.jit
def scalp_area(scalp: Scalp, uv: Float[Array, "points 2"]) -> Float[Array, " points"]:
    """Return the area of the scalp, in square metres, for 1 of scalp space."""
    tangents = jax.vmap(scalp_tangents, (None, 0))(scalp, uv)
    return norm(jnp.cross(tangents.u, tangents.v))


def owned_region(tree: HairTree, index: int) -> ScalpContour:
    """Return a cluster's contour without what its siblings own, or those above.

    Contours overlap, and a child among the roots of a sibling would own none. Each
    spoke ends where the cluster first owns a root no more, to 1/24 of its length. A
    cluster that does not own its centre has its contour as it is.

    Args:
        tree: The tree.
        index: A cluster without children.
    """
    contour = cluster(tree.contour, index)
    reach = np.maximum(np.asarray(contour.radius + contour.offset, np.float64), 0.0)
    share = (np.arange(ALONG) + 0.5) / ALONG
    at = reach[:, None] * share[None]
    uv = np.asarray(contour.centre, np.float64) + at[..., None] * spokes()[:, None]
    mine = np.asarray(find_owner(tree, uv.reshape(-1, 2))) == index
    mine &= np.all((uv >= 0.0) & (uv <= 1.0), axis=-1).reshape(-1)
    held = np.cumprod(mine.reshape(at.shape), axis=1).sum(axis=1)
    if not held.all():
        return contour
    left = reach * held / ALONG
    return cluster(star_contours(contour.centre[None], left[None]), 0)


def scatter_centres(
    scalp: Scalp,
    contour: ScalpContour,
    count: int,
    key: PRNGKeyArray | UInt32[Array, " 2"],
) -> Float[Array, "count 2"]:
    """Return random positions in a contour, as dense everywhere (figure 4-13a).

    Dense by the scalp's area in metres, like roots. Runs outside `jit`.

    Args:
        scalp: The scalp.
        contour: One contour.
        count: Number of positions.
        key: Randomness.

    Raises:
        ValueError: If the contour has no area on the scalp, or `count` is below 1.
    """
    if count < 1:
        raise ValueError(f"a cluster has 1 child or more, got a count of {count}.")
    batch = FULL * -(-count // FULL) * 16
    found = []
    for i in range(ROUNDS):
        draw = draw_centres(scalp, contour, jax.random.fold_in(key, i), batch)
        found += list(np.asarray(draw.uv)[np.asarray(draw.inside)])
        if len(found) >= count:
            return jnp.asarray(np.stack(found[:count]))
    raise ValueError(
        "the contour has hardly any area on the scalp; its centre is "
        f"{np.asarray(contour.centre).tolist()} and its radius {float(contour.radius)}."
    )


class Draw(NamedTuple):
    """Random positions around a contour, and which of them count."""

    uv: Float[Array, "draws 2"]
    inside: Bool[Array, " draws"]


@functools.partial(jax.jit, static_argnames="count")
def draw_centres(
    scalp: Scalp,
    contour: ScalpContour,
    key: PRNGKeyArray | UInt32[Array, " 2"],
    count: int,
) -> Draw:
    """Return random positions in the box around a contour."""
    outline = jnp.clip(contour_outline(contour), 0.0, 1.0)
    low, high = jnp.min(outline, axis=0), jnp.max(outline, axis=0)
    place_key, keep_key = jax.random.split(key)
    dtype = contour.centre.dtype
    place = jax.random.uniform(place_key, (count, 2), dtype)
    uv = low[None] + place * (high - low)[None]
    area = scalp_area(scalp, uv)
    inside = jax.vmap(contains, (None, 0))(contour, uv)
    most = jnp.max(jnp.where(inside, area, 0.0))
    keep = jax.random.uniform(keep_key, (count,), dtype) * most <= area
    return Draw(uv, inside & keep & jnp.all(high > low))


def relax_centres(
    scalp: Scalp,
    contour: ScalpContour,
    centres: Float[Array, "children 2"],
    borders: Sequence[Border] = (),
) -> Float[Array, "children 2"]:
    """Return positions spread evenly over a contour (figure 4-13b).

    Points push each other away where they are closer than an even pattern of triangles
    has them, less and less in the course of 48 steps, and those that leave the contour
    are put back [Turk 1991, Generating textures on arbitrary surfaces]. Distances are
    those in space between points of the scalp, so that positions are even in metres.

    The contour and borders push as if each point had its mirror image behind them: a
    child then stands beside a parting, half of a child's distance off it.

    Args:
        scalp: The scalp.
        contour: The contour that holds the positions.
        centres: The positions.
        borders: Polylines in scalp space.
    """
    filled = fill(centres)
    real = np.arange(len(filled)) < len(centres)
    outline = np.clip(contour_outline(contour, PIECES + 1), 0.0, 1.0)
    at = [np.linspace(0.0, len(b) - 1.0, PIECES + 1) for b in borders]
    lines = [
        np.stack([np.interp(t, np.arange(len(b)), x) for x in np.asarray(b).T], axis=1)
        for t, b in zip(at, borders, strict=True)
    ]
    pieces = [np.stack([p[:-1], p[1:]], axis=1) for p in [outline, *lines]]
    walls = np.concatenate(pieces)
    walls = np.resize(walls, (WALLS * -(-len(walls) // WALLS), 2, 2))
    walls = jnp.asarray(walls.astype(filled.dtype))
    evenly = relax(scalp, contour, jnp.asarray(filled), jnp.asarray(real), walls)
    return jnp.asarray(np.asarray(evenly)[: len(centres)])


@jax.jit
def relax(
    scalp: Scalp,
    contour: ScalpContour,
    centres: Float[Array, "children 2"],
    real: Bool[Array, " children"],
    walls: Float[Array, "pieces 2 2"],
) -> Float[Array, "children 2"]:
    """Relax positions; those that are not real push no other one.

    Args:
        scalp: The scalp.
        contour: The contour that holds the positions.
        centres: The positions.
        real: Which of them count.
        walls: Ends of the pieces of the contour and of borders, in scalp space.
    """
    on_scalp = jax.vmap(scalp_point, (None, 0))
    start, end = on_scalp(scalp, walls[:, 0]), on_scalp(scalp, walls[:, 1])
    spacing = even_spacing(scalp, contour, jnp.sum(real))

    def push(uv: Float[Array, " 2"], every: Float[Array, "children 3"]):
        p, (du, dv) = scalp_point(scalp, uv), scalp_tangents(scalp, uv)
        away = p[None] - every
        short = jnp.where(real, jnp.maximum(spacing - norm(away), 0.0), 0.0)
        force = jnp.sum(short[:, None] * unit(away, jnp.zeros_like(away)), axis=0)
        rest = p - closest_on_pieces(p, start, end)
        short = jnp.maximum(spacing - 2.0 * norm(rest), 0.0)
        force = force + short * unit(rest, unit(du, jnp.zeros_like(du)))
        # One of a pair goes half of the way, and none further than that in a step.
        force = 0.5 * force / jnp.maximum(norm(force) / spacing, 1.0)
        # From space to the scalp: the least squares of J (du, dv) = force.
        e, f, g = jnp.dot(du, du), jnp.dot(du, dv), jnp.dot(dv, dv)
        a, b = jnp.dot(du, force), jnp.dot(dv, force)
        det = e * g - f * f + 1e-6 * (e + g) ** 2 + TINY
        return jnp.stack([g * a - f * b, e * b - f * a]) / det

    def step(uv: Float[Array, "children 2"], strength: Float[Array, ""]):
        move = jax.vmap(push, (0, None))(uv, on_scalp(scalp, uv))
        uv = jnp.clip(uv + strength * move, 0.0, 1.0)
        return jax.vmap(put_back, (None, 0))(contour, uv), None

    strength = jnp.linspace(1.0, 0.0, STEPS, endpoint=False, dtype=centres.dtype)
    return jax.lax.scan(step, centres, strength)[0]


def even_spacing(
    scalp: Scalp, contour: ScalpContour, count: Int[Array, ""]
) -> Float[Array, ""]:
    """Return the distance of points that fill a contour in a pattern of triangles."""
    outline = jnp.clip(contour_outline(contour), 0.0, 1.0)
    p = jax.vmap(scalp_point, (None, 0))(scalp, outline)
    p = p - scalp_point(scalp, contour.centre)[None]
    area = 0.5 * jnp.sum(norm(jnp.cross(p[:-1], p[1:])))
    return jnp.sqrt(2.0 / jnp.sqrt(3.0) * area / count.astype(area.dtype)) + TINY


def closest_on_pieces(
    p: Float[Array, " 3"],
    start: Float[Array, "pieces 3"],
    end: Float[Array, "pieces 3"],
) -> Float[Array, " 3"]:
    """Return the point closest to `p` on some straight pieces."""
    along = end - start
    square = jnp.sum(along * along, axis=1) + TINY**2
    share = jnp.sum((p[None] - start) * along, axis=1) / square
    at = start + jnp.clip(share, 0.0, 1.0)[:, None] * along
    return at[jnp.argmin(norm(at - p[None]))]


def put_back(contour: ScalpContour, uv: Float[Array, " 2"]) -> Float[Array, " 2"]:
    """Return a point, moved towards the contour's centre if it left the contour."""
    delta = uv - contour.centre
    theta = local_coordinates(contour, uv).theta
    radius = contour_radius(contour.radius, contour.offset, theta)
    furthest = jnp.maximum(WITHIN * radius, 0.0)
    inside = jnp.minimum(furthest / jnp.maximum(norm(delta), TINY), 1.0)
    return contour.centre + inside * delta
