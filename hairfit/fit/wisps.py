"""The finest level of a tree from strands: what its clusters cannot say."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..model.cylinder import cylinder_frames
from ..model.strand import strand_knots
from ..model.tree import HairTree
from ..model.wisp import Wisps, nearest_wisp
from .cluster import kmeans
from .gather import Rooted

# What a metre on the scalp counts against a metre beside the cluster, at every knot.
PLACE_WEIGHT = 0.5
# Strands whose residuals are found at once.
CHUNK = 8192


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
    found = [np.zeros((0, *rooted.knots.shape[1:]))]
    for i in range(0, len(owner), CHUNK):
        some = slice(i, i + CHUNK)
        rest = _residuals(
            tree.contour,
            tree.cylinder,
            jnp.asarray(rooted.uv[some], kind),
            jnp.asarray(owner[some], jnp.int32),
            jnp.asarray(rooted.knots[some], kind),
        )
        found.append(np.asarray(rest, np.float64))
    return np.concatenate(found)


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
    root in the middle of each such group. It says the mean of the strands that are
    going to follow it, which are those with the closest roots.

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
    held = np.flatnonzero(follows >= 0)
    total = np.zeros_like(rest[chosen])
    np.add.at(total, follows[held], rest[held])
    number = np.bincount(follows[held], minlength=len(chosen))
    some = number > 0  # one of two wisps with the same root has no followers
    offset = total[some] / number[some, None, None]
    wisps = jax.tree.map(lambda leaf: leaf[np.flatnonzero(some)], wisps)
    wisps = eqx.tree_at(lambda w: w.offset, wisps, jnp.asarray(offset, kind))
    return eqx.tree_at(lambda t: t.wisps, tree, wisps, is_leaf=lambda x: x is None)


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
    share = np.round(count * square / max(square.sum(), 1e-30)).astype(int)
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
            away = features[some] - features[some].mean(axis=0)
            chosen.append(mine[some[np.argmin((away**2).sum(axis=1))]])
    return np.array(sorted(chosen), int)
