"""Wisps: how hair runs beside what its cluster says, kept hair by hair."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from scipy.spatial import KDTree

from .curve import EXACT, linear_weights
from .cylinder import Sections

# Apart in the search for the nearest wisp: more than scalp space measures.
APART = 16.0


class Wisps(eqx.Module):
    """The finest level of a tree: offsets of single hairs from their cluster.

    A generalized cylinder says where hair runs up to a smooth map of its cross-section.
    What it cannot say, a residual of a fit or the pattern of a comb, is kept here for
    some roots; a strand takes it from the nearest wisp of its own cluster.

    Attributes:
        uv: Roots of the wisps, in scalp space.
        owner: The leaf cluster of each wisp.
        offset: Offset at each knot along tangent, normal and binormal, in metres.
            Normal and binormal are turned by the cluster's twist, so that a wisp turns
            with its cluster.
    """

    uv: Float[Array, "wisps 2"]
    owner: Int[Array, " wisps"]
    offset: Float[Array, "wisps knots 3"]


def nearest_wisp(
    wisps: Wisps,
    uv: Float[Array | np.ndarray, "strands 2"],
    owner: Int[Array | np.ndarray, " strands"],
) -> Int[Array, " strands"]:
    """Return the wisp that each strand follows, -1 where its cluster has none.

    It is the one with the closest root among those of the strand's own cluster; of
    equal distances the first. This is topology, without gradients, and runs outside
    `jit`.

    Args:
        wisps: The wisps.
        uv: Roots of the strands.
        owner: The cluster of each strand, -1 for none.
    """
    mine = np.asarray(owner)
    found = np.full(len(mine), -1, np.int32)
    if len(wisps.owner) == 0 or len(mine) == 0:
        return jnp.asarray(found)

    def place(root, cluster):
        row = APART * np.asarray(cluster, np.float64)[:, None]
        return np.concatenate([np.asarray(root, np.float64), row], axis=1)

    has = np.flatnonzero(np.isin(mine, np.asarray(wisps.owner)))
    near = KDTree(place(wisps.uv, wisps.owner))
    index = near.query(place(np.asarray(uv)[has], mine[has]))[1]
    found[has] = index
    return jnp.asarray(found)


def wisp_points(
    sections: Sections, offset: Float[Array, "knots 3"], t: Float[Array, " points"]
) -> Float[Array, "points 3"]:
    """Return the offsets of one wisp in the world, in metres.

    Args:
        sections: The cluster's cross-sections at `t`.
        offset: Offsets of the wisp at the knots.
        t: Where along the cluster.
    """
    weights = linear_weights(offset.shape[0], t)
    along, across, side = jnp.matmul(weights, offset, precision=EXACT).T
    cos, sin = jnp.cos(sections.twist), jnp.sin(sections.twist)
    tangent, normal, binormal = sections.frames
    return (
        along[:, None] * tangent
        + (cos * across - sin * side)[:, None] * normal
        + (sin * across + cos * side)[:, None] * binormal
    )
