"""Strands from elsewhere become a hair tree, bottom-up [Kim02, section 7.5]."""

import dataclasses
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..errors import InputError
from ..host import on_device
from ..model.cylinder import GeneralizedCylinder
from ..model.ownership import find_owner
from ..model.scalp import Scalp, scalp_point, scalp_tangents
from ..model.tree import HairTree, ScalpContour
from ..types import Strands
from .borders import draw_contours, move_starved
from .cluster import scalp_metric
from .cylinders import FittedTree, Members, cylinders_along, refine_cylinders
from .density import density_maps, root_spacing
from .gather import Maps, Rooted, gather_strands, gather_upwards, robust_maps
from .root_scalp import root_places
from .wisps import add_wisps, wisp_residuals

# What a root of another cluster counts against one of its own where a cluster ends.
AGAINST = 0.3
# Leaves that own less than this share of their strands' roots get another centre.
STARVED, STARVED_ROUNDS = 0.3, 3
# Contours reach beyond their outermost roots by so much of the distance between roots.
BEYOND = 0.5
# Leaves where no number is asked for, and strands for each of them at least.
LEAVES, STRANDS_A_LEAF = 500, 5
# Places of the scalp that are looked up at once.
AT_ONCE = 4096
# Strands of no more than this have no direction. Metres.
SHORTEST = 1e-6


@dataclasses.dataclass(frozen=True)
class TreeifyConfig:
    """How strands become a tree."""

    leaves: int | None = None
    """Number of leaf clusters; None for 500, or fewer where strands are few."""
    levels: int = 2
    """Number of levels: root clusters, and so on to the leaves."""
    knots: int = 24
    """Control points of every skeleton."""
    wisps: int = 1000
    """Number of wisps in all, which keep what clusters cannot say; 0 for none."""
    rounds: int = 12
    """Rounds in which strands choose their clusters."""
    steps: int = 0
    """Steps of Levenberg-Marquardt on all clusters after the closed form."""
    seed: int = 0
    """Of all that is random."""


class Treeified(NamedTuple):
    """A tree, and where in it the strands are that it was made from.

    `grow_strands(tree, uv, owner, eta, points)` grows them again.

    Attributes:
        tree: The tree. Its maps hold the density of the roots.
        uv: Root of each strand, in scalp space.
        owner: The leaf that each strand was gathered into. In overlaps of leaves it is
            not always the one that `find_owner` says.
        eta: Share of the cluster's length that each strand reaches.
        figures: `root_distance_m`: median distance of roots from the scalp;
            `error_m`: root mean square distance of knots, without wisps; `housed`:
            share of the strands whose leaf is the one that `find_owner` says.
    """

    tree: HairTree
    uv: Float[np.ndarray, "strands 2"]
    owner: Int[np.ndarray, " strands"]
    eta: Float[np.ndarray, " strands"]
    figures: dict[str, float]


class Levels(NamedTuple):
    """Clusters of all levels, root clusters first.

    Attributes:
        parent: Each cluster's parent.
        maps: What the clusters say of their strands.
        label: One row a level, root clusters first: each strand's cluster.
    """

    parent: tuple[int, ...]
    maps: Maps
    label: Int[np.ndarray, "levels strands"]


def treeify(strands: Strands, scalp: Scalp, config: TreeifyConfig) -> Treeified:
    """Return a hair tree whose strands are, as closely as it can, the given ones.

    Leaves are gathered first and the clusters above from them. A cluster's skeleton is
    the mean of its strands; at every knot its cross-section is the linear map of their
    roots by least squares. Every strand counts by shares of its own length, so the maps
    hold lengths too. Wisps keep the rest for some strands.

    Args:
        strands: The strands, root first.
        scalp: The scalp, as `scalp_for` makes it.
        config: Numbers of clusters, levels, knots and wisps.

    Raises:
        InputError: If there are fewer strands than leaves, a strand has no length or is
            not finite, or the numbers of the configuration make no tree.
    """
    count = leaf_count(strands, config)
    check(strands, config, count)
    rooted, apart = root_strands(strands, scalp, config.knots)
    levels = gather_levels(rooted, count, config)
    tree, error, _ = fit_levels(scalp, rooted, levels, config.steps)
    maps = density_maps(scalp, rooted.uv)
    tree = eqx.tree_at(lambda t: t.maps, tree, maps, is_leaf=lambda x: x is None)
    owner = levels.label[-1]
    if config.wisps:
        tree = add_wisps(tree, rooted, owner, config.wisps, config.seed)
    figures = {
        "root_distance_m": float(np.median(apart)),
        "error_m": error,
        "housed": float(np.mean(np.asarray(find_owner(tree, rooted.uv)) == owner)),
    }
    return Treeified(tree, rooted.uv, owner, np.ones(len(owner)), figures)


def leaf_count(strands: Strands, config: TreeifyConfig) -> int:
    """Return how many leaves a tree of these strands shall have."""
    if config.leaves is not None:
        return config.leaves
    return max(1, min(LEAVES, strands.count // STRANDS_A_LEAF))


def check(strands: Strands, config: TreeifyConfig, leaves: int) -> None:
    """Refuse what cannot become a tree."""
    if min(leaves, config.levels) < 1 or config.knots < 4 or config.wisps < 0:
        raise InputError(
            f"a tree has at least 1 leaf, 1 level, 4 knots and 0 wisps, not "
            f"{leaves}, {config.levels}, {config.knots} and {config.wisps}; "
            "give larger numbers."
        )
    if strands.count < 1:
        raise InputError("there is no strand; give a file that holds some.")
    if not np.isfinite(strands.points).all():
        raise InputError(
            "some points of strands are not finite numbers; export the strands again."
        )
    if strands.count < leaves:
        raise InputError(
            f"{strands.count} strands cannot fill {leaves} leaf clusters; ask "
            f"for {max(1, strands.count // 4)} leaves or fewer."
        )
    bad = int((lengths(strands) <= SHORTEST).sum())
    if bad:
        raise InputError(
            f"{bad} of {strands.count} strands are single points or have no length; "
            "leave them out of the file."
        )


def lengths(strands: Strands) -> Float[np.ndarray, " strands"]:
    """Return the strands' lengths, in metres."""
    points = strands.points.astype(np.float64)
    steps = np.linalg.norm(np.diff(points, axis=0, append=points[-1:]), axis=1)
    steps[strands.offsets[1:] - 1] = 0.0  # from one strand's tip to the next root
    return np.add.reduceat(steps, strands.offsets[:-1])


class OnScalp(NamedTuple):
    """Strands on a scalp, and how far their roots were from it, in metres."""

    rooted: Rooted
    apart: Float[np.ndarray, " strands"]


def root_strands(strands: Strands, scalp: Scalp, knots: int) -> OnScalp:
    """Return the strands at even shares of their length, rooted on the scalp."""
    lines = strands.resample(knots)
    uv = root_places(scalp, lines[:, 0])
    point, ground = on_scalp(scalp, uv)
    apart = np.linalg.norm(point - lines[:, 0], axis=1)
    lines[:, 0] = point
    return OnScalp(Rooted(uv, lines, ground), apart)


class Ground(NamedTuple):
    """Points of the scalp, and how they move with u and v, in metres."""

    point: Float[np.ndarray, "points 3"]
    slope: Float[np.ndarray, "points 3 2"]


def on_scalp(scalp: Scalp, uv: Float[np.ndarray | Array, "points 2"]) -> Ground:
    """Return the scalp's points and slopes at many places.

    So many at once, or each number of places would be compiled anew.
    """
    places = np.pad(np.asarray(uv), [(0, -len(uv) % AT_ONCE), (0, 0)])
    found = [
        _on_scalp(scalp, on_device(some, scalp.control.dtype))
        for some in places.reshape(-1, AT_ONCE, 2)
    ]
    rows = (np.concatenate(part)[: len(uv)] for part in zip(*found, strict=True))
    return Ground(*(np.asarray(row, np.float64) for row in rows))


@jax.jit
def _on_scalp(scalp: Scalp, uv: Float[Array, "points 2"]):
    point = jax.vmap(scalp_point, (None, 0))(scalp, uv)
    tangents = jax.vmap(scalp_tangents, (None, 0))(scalp, uv)
    return point, jnp.stack(tangents, axis=-1)


def gather_levels(rooted: Rooted, leaves: int, config: TreeifyConfig) -> Levels:
    """Return so many leaves, at most, and the clusters above, gathered from below."""
    label = gather_strands(rooted, leaves, rounds=config.rounds, seed=config.seed)
    return levels_above(rooted, label, config)


def levels_above(
    rooted: Rooted, label: Int[np.ndarray, " strands"], config: TreeifyConfig
) -> Levels:
    """Return leaves, given the leaf of each strand without gaps, and what is above."""
    labels, maps, above = [label], [robust_maps(rooted, label)], []
    sizes = level_sizes(len(maps[0].middle), config.levels)
    for wanted in reversed(sizes[:-1]):
        above.insert(0, gather_upwards(maps[0], wanted, config.seed))
        labels.insert(0, above[0][labels[0]])
        maps.insert(0, robust_maps(rooted, labels[0]))
    start = np.cumsum([0] + [len(one.middle) for one in maps])
    parent = [-1] * int(start[1])
    for level, one in enumerate(above):
        parent += (one + start[level]).tolist()
    joined = Maps(*(np.concatenate(rows) for rows in zip(*maps, strict=True)))
    return Levels(tuple(parent), joined, np.stack(labels) + start[:-1, None])


def level_sizes(leaves: int, levels: int) -> list[int]:
    """Return how many clusters each level has at most, in even steps of their root."""
    return [max(1, round(leaves ** (k / levels))) for k in range(1, levels + 1)]


def fit_levels(scalp: Scalp, rooted: Rooted, levels: Levels, steps: int) -> FittedTree:
    """Return the tree of clusters, in closed form and then by least squares.

    The least squares (`refine_cylinders`) moves skeletons and cross-sections of all
    levels together. It is kept if it brings the leaves closer to their strands.
    """
    kind = scalp.control.dtype
    maps, leaf = levels.maps, levels.label[-1]
    contour = first_contours(rooted, levels)
    tree = plain_tree(scalp, contour, maps, levels.parent)
    for _ in range(STARVED_ROUNDS):
        contour = fed_contours(tree, rooted, leaf)
        tree = eqx.tree_at(lambda t: t.contour, tree, cast(contour, kind))
    tree = plain_tree(scalp, contour, maps, levels.parent)
    error = distance(tree, rooted, leaf)
    if not steps:
        return FittedTree(tree, error, "")
    members = Members(
        on_device(np.tile(rooted.uv, (len(levels.label), 1)), kind),
        on_device(levels.label.ravel(), jnp.int32),
        on_device(np.tile(rooted.knots, (len(levels.label), 1, 1)), kind),
    )
    found = refine_cylinders(tree, members, steps)
    closer = distance(found.tree, rooted, leaf)
    if closer > error:
        return FittedTree(tree, error, found.result)
    return FittedTree(found.tree, closer, found.result)


def distance(
    tree: HairTree, rooted: Rooted, owner: Int[np.ndarray, " strands"]
) -> float:
    """Return the root mean square distance of knots from the tree's, in metres."""
    rest = wisp_residuals(tree, rooted, owner)[:, 1:]
    return float(np.sqrt((rest**2).sum(axis=2).mean()))


def first_contours(rooted: Rooted, levels: Levels) -> ScalpContour:
    """Return the contours of all levels about the means of their roots."""
    margin = BEYOND * root_spacing(rooted.uv)
    parts = []
    for label in levels.label:
        first, count = int(label.min()), len(np.unique(label))
        middle = levels.maps.middle[first : first + count]
        parts.append(
            draw_contours(
                rooted.uv, label - first, middle, against=AGAINST, margin=margin
            )
        )
    return jax.tree.map(lambda *rows: on_device(np.concatenate(rows)), *parts)


def fed_contours(
    tree: HairTree, rooted: Rooted, leaf: Int[np.ndarray, " strands"]
) -> ScalpContour:
    """Return contours in which leaves that owned nearly no root stand elsewhere.

    Leaves may lie upon one another: of those with one centre only one is ever closest.
    """
    first = int(leaf.min())
    owner = np.asarray(find_owner(tree, rooted.uv))
    held = np.bincount(owner[owner >= first] - first, minlength=tree.count - first)
    members = np.bincount(leaf - first)
    starved = held < STARVED * members
    centre = np.asarray(tree.contour.centre, np.float64)[first:]
    centre = move_starved(rooted.uv, leaf - first, centre, starved)
    margin = BEYOND * root_spacing(rooted.uv)
    drawn = draw_contours(
        rooted.uv, leaf - first, centre, against=AGAINST, margin=margin
    )

    def joined(old, new):
        rows = [np.asarray(old)[:first], np.asarray(new, old.dtype)]
        return on_device(np.concatenate(rows))

    return jax.tree.map(joined, tree.contour, drawn)


def plain_tree(
    scalp: Scalp, contour: ScalpContour, maps: Maps, parent: tuple[int, ...]
) -> HairTree:
    """Return the tree of what clusters say, about their contours' centres."""
    kind = scalp.control.dtype
    contour = cast(contour, kind)
    metric = np.asarray(scalp_metric(scalp, contour), np.float64)
    moved = np.asarray(contour.centre, np.float64) - maps.middle
    skeleton = maps.curve + np.einsum("gkxi,gi->gkx", maps.slope, moved)
    per_metre = maps.slope / metric[:, None, None, None]
    cylinder = cast(cylinders_along(contour, metric, skeleton, per_metre), kind)
    still = on_device(np.zeros(len(parent)), kind)
    return HairTree(scalp, contour, cylinder, still, parent)


Cast = TypeVar("Cast", ScalpContour, GeneralizedCylinder)


def cast(module: Cast, kind) -> Cast:
    """Return a module in the scalp's precision."""
    return jax.tree.map(lambda leaf: on_device(leaf, kind), module)
