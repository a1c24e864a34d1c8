"""The finest level of a tree from strands: what its clusters cannot say."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..host import on_device
from ..model.cylinder import cylinder_frames, together
from ..model.strand import strand_knots
from ..model.tree import HairTree, filled
from ..model.wisp import Wisps, nearest_wisp
from .cluster import kmeans
from .gather import Rooted

# What a metre on the scalp counts against a metre beside the cluster, at every knot.
PLACE_WEIGHT = 0.5
# A leaf has so many wisps at least, or none.
FEWEST = 2
# Strands whose residuals are found at once, however few there are: one program.
CHUNK = 4096


def wisp_residuals(
    tree: HairTree, rooted: Rooted, owner: Int[np.ndarray, " strands"]
) -> Float[np.ndarray, "strands knots 3"]:
    """Return what strands do beside their clusters, as `Wisps` hold it, in metres.

    Args:
        tree: The tree.
        rooted: The strands, with as many knots as the tree has.
        owner: The leaf of each strand.
    """
    kind = tree.scalp.control.dtype
    contour, cylinder = filled(tree, together(tree.count))
    spare = -len(owner) % CHUNK
    uv, owners, knots = (
        np.pad(one, [(0, spare), *[(0, 0)] * (one.ndim - 1)])
        for one in (rooted.uv, owner, rooted.knots)
    )
    found = [np.zeros((0, *knots.shape[1:]))]
    for i in range(0, len(owners), CHUNK):
        some = slice(i, i + CHUNK)
        rest = _residuals(
            contour,
            cylinder,
            on_device(uv[some], kind),
            on_device(owners[some], jnp.int32),
            on_device(knots[some], kind),
        )
        found.append(np.asarray(rest, np.float64))
    return np.concatenate(found)[: len(owner)]


@jax.jit
def _residuals(
    contour,
    cylinder,
    uv: Float[Array, "strands 2"],
    owner: Int[Array, " strands"],
    knots: Float[Array, "strands knots 3"],
) -> Float[Array, "strands knots 3"]:
    frames = jax.vmap(cylinder_frames)(cylinder)

    def one(index, root, strand):
        parts = (contour, cylinder, frames)
        place, body, axes = jax.tree.map(lambda leaf: leaf[index], parts)
        whole = jnp.ones((), strand.dtype)
        rest = strand - strand_knots(place, body, axes, root, whole)
        cos, sin = jnp.cos(body.twist)[:, None], jnp.sin(body.twist)[:, None]
        tangent, normal, binormal = axes
        axes = (tangent, cos * normal + sin * binormal, cos * binormal - sin * normal)
        return jnp.stack([jnp.sum(rest * axis, axis=1) for axis in axes], axis=1)

    return jax.vmap(one)(owner, uv, knots)


def add_wisps(
    tree: HairTree,
    rooted: Rooted,
    owner: Int[np.ndarray, " strands"],
    count: int,
    seed: int,
) -> HairTree:
    """Return the tree with wisps for the strands that its clusters miss.

    Leaves get wisps by their share of the squares that they miss. Within a leaf k-means
    gathers strands by what they miss and where they are rooted; a wisp stands at the
    root in the middle of each such group. It says the medoid of the strands that are
    going to follow it, which are those with the closest roots: a mean would lose the
    waves that each strand has for itself.

    Args:
        tree: The tree.
        rooted: The strands, with as many knots as the tree has.
        owner: The leaf of each strand.
        count: Number of wisps, about; there are no more than strands.
        seed: Of k-means.
    """
    rest = wisp_residuals(tree, rooted, owner)
    rest[:, 0] = 0.0  # strands are rooted on the scalp
    chosen = choose_wisps(tree, rooted.uv, owner, rest, count, seed)
    kind = tree.scalp.control.dtype
    wisps = Wisps(
        jnp.asarray(rooted.uv[chosen], kind),
        jnp.asarray(owner[chosen], jnp.int32),
        jnp.asarray(rest[chosen], kind),
    )
    follows = np.asarray(nearest_wisp(wisps, rooted.uv, owner))
    flat = rest.reshape(len(rest), -1)
    order = np.argsort(follows, kind="stable")
    groups = np.split(order, np.searchsorted(follows[order], np.arange(len(chosen))))
    # One of two wisps with the same root has no followers.
    some = [i for i, group in enumerate(groups[1:]) if len(group)]
    spoken = [medoid(flat, groups[1 + i]) for i in some]
    wisps = jax.tree.map(lambda leaf: leaf[np.asarray(some, int)], wisps)
    offset = jnp.asarray(rest[np.asarray(spoken, int)], kind)
    wisps = eqx.tree_at(lambda w: w.offset, wisps, offset)
    return eqx.tree_at(lambda t: t.wisps, tree, wisps, is_leaf=lambda x: x is None)


def medoid(
    rows: Float[np.ndarray, "strands features"], group: Int[np.ndarray, " members"]
) -> int:
    """Return the strand of a group whose features are closest to the group's mean."""
    away = rows[group] - rows[group].mean(axis=0)
    return int(group[np.argmin((away**2).sum(axis=1))])


def choose_wisps(
    tree: HairTree,
    uv: Float[np.ndarray, "strands 2"],
    owner: Int[np.ndarray, " strands"],
    rest: Float[np.ndarray, "strands knots 3"],
    count: int,
    seed: int,
) -> Int[np.ndarray, " wisps"]:
    """Return the strands at whose roots wisps stand, in increasing order."""
    flat = rest.reshape(len(rest), -1)
    square = np.bincount(owner, (flat**2).sum(axis=1), minlength=tree.count)
    share = shared_out(count, square)
    # One wisp alone would stand for the whole leaf, which its skeleton does better.
    several = share >= FEWEST
    share = (
        shared_out(count, np.where(several, square, 0.0)) if several.any() else share
    )
    metric = np.asarray(tree.cylinder.radius[:, 0] / tree.contour.radius, np.float64)
    rng = np.random.default_rng(seed)
    chosen = []
    for index in np.flatnonzero(share):
        mine = np.flatnonzero(owner == index)
        place = uv[mine] * (metric[index] * PLACE_WEIGHT * rest.shape[1] ** 0.5)
        features = np.concatenate([place, flat[mine]], axis=1)
        group = kmeans(features, int(share[index]), rng)
        for label in np.unique(group):
            some = np.flatnonzero(group == label)
            chosen.append(mine[medoid(features, some)])
    return np.array(sorted(chosen), int)


def shared_out(
    count: int, weight: Float[np.ndarray, " leaves"]
) -> Int[np.ndarray, " leaves"]:
    """Return whole numbers in proportion to weights, by the largest remainders.

    Args:
        count: Their sum, where any weight is positive; else 0.
        weight: The weights.
    """
    total = weight.sum()
    if total <= 0.0:
        return np.zeros(len(weight), int)
    exact = count * weight / total
    share = exact.astype(int)
    rest = count - share.sum()
    share[np.argsort(share - exact, kind="stable")[:rest]] += 1
    return share
