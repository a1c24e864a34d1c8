"""Grown strands are gathered into clusters, two levels of them."""

import functools
import warnings
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from scipy.cluster.vq import kmeans2

from ..model.contour import ANGLES
from ..model.ownership import find_owner
from ..model.scalp import Scalp, scalp_tangents
from ..model.tiling import cell_reach, spokes, star_contours
from ..model.tree import HairTree, ScalpContour, plant, take

# Roots count more than other points of a strand: a cluster must be one piece of scalp.
ROOT_WEIGHT = 3.0
# Contours of root clusters overlap, so that every root lies in one [Kim02, 4.5].
OVERLAP = 1.4
LEAF_OVERLAP = 1.15
SHAPE_POINTS = 6
STUB = 0.01  # metres


class Layout(NamedTuple):
    """Where the clusters of a tree are rooted and how they hang together.

    Attributes:
        tree: The clusters, root clusters first, planted as straight stubs.
        metric: Metres on the scalp for 1 of scalp space at each contour's centre.
        owner: The leaf that owns each strand, -1 if none does.
    """

    tree: HairTree
    metric: Float[np.ndarray, " clusters"]
    owner: Int[np.ndarray, " strands"]


def lay_clusters(
    scalp: Scalp,
    uv: Float[np.ndarray, "strands 2"],
    strands: Float[np.ndarray, "strands knots 3"],
    *,
    roots: int,
    leaves: int,
    seed: int,
) -> Layout:
    """Return the scalp contours of clusters of strands that start and run alike.

    Args:
        scalp: The scalp.
        uv: Roots of the strands in scalp space.
        strands: The strands, root first.
        roots: Number of root clusters wanted.
        leaves: Number of leaf clusters wanted, shared out by the number of strands.
        seed: Of the k-means.
    """
    knots = strands.shape[1]
    at = np.linspace(0, knots - 1, SHAPE_POINTS + 1).round().astype(int)
    features = strands[:, at].copy()
    features[:, 0] *= ROOT_WEIGHT
    features = features.reshape(len(strands), -1)
    rng = np.random.default_rng(seed)
    upper = np.unique(kmeans(features, roots, rng), return_inverse=True)[1]
    centre = [uv[upper == index].mean(axis=0) for index in range(upper.max() + 1)]
    reach = list(cell_reach(np.array(centre)) * OVERLAP)
    parent = [-1] * len(centre)
    spacing = np.sqrt(1.0 / len(uv))
    # A root goes to the closest centre that contains it, so cells hold those roots.
    held = _closest(uv, np.array(centre))
    for index in range(len(centre)):
        members = np.flatnonzero(held == index)
        around = star_reach(uv[members] - centre[index], spacing) * LEAF_OVERLAP
        reach[index] = np.minimum(reach[index], around)
        share = max(1, round(leaves * len(members) / len(uv)))
        lower = kmeans(features[members], share, rng)
        for label in np.unique(lower):
            mine = uv[members[lower == label]]
            centre.append(mine.mean(axis=0))
            reach.append(star_reach(mine - centre[-1], spacing) * LEAF_OVERLAP)
            parent.append(index)
    return _planted(scalp, uv, np.array(centre), np.array(reach), parent, knots)


def _planted(
    scalp: Scalp,
    uv: Float[np.ndarray, "strands 2"],
    centre: Float[np.ndarray, "clusters 2"],
    reach: Float[np.ndarray, "clusters 32"],
    parent: list[int],
    knots: int,
) -> Layout:
    """Return the clusters with contours that reach so far around their centres."""
    contour = star_contours(centre, reach)
    stub = functools.partial(plant, scalp, length=STUB, knots=knots)
    still = jnp.zeros_like(contour.radius)
    tree = HairTree(scalp, contour, jax.vmap(stub)(contour), still, tuple(parent))
    metric = scalp_metric(scalp, contour)
    return _without_empty(Layout(tree, metric, np.asarray(find_owner(tree, uv))), uv)


def scalp_metric(scalp: Scalp, contour: ScalpContour) -> Float[np.ndarray, " clusters"]:
    """Return metres on the scalp for 1 of scalp space at each contour's centre."""
    tangents = jax.vmap(scalp_tangents, (None, 0))(scalp, contour.centre)
    area = np.cross(np.asarray(tangents.u), np.asarray(tangents.v))
    return np.sqrt(np.linalg.norm(area, axis=1))


def _without_empty(layout: Layout, uv: Float[np.ndarray, "strands 2"]) -> Layout:
    """Drop the clusters that own no strand, nor have a child that does."""
    parent = np.asarray(layout.tree.parent)
    keep = np.bincount(layout.owner[layout.owner >= 0], minlength=len(parent)) > 0
    above = parent[keep]
    keep[above[above >= 0]] = True
    tree = take(layout.tree, keep)
    return Layout(tree, layout.metric[keep], np.asarray(find_owner(tree, uv)))


def kmeans(
    features: Float[np.ndarray, "strands features"], count: int, rng
) -> Int[np.ndarray, " strands"]:
    """Return the cluster of each strand by k-means; clusters may lack strands."""
    count = min(count, len(features))
    if count <= 1:
        return np.zeros(len(features), int)
    start = features[rng.choice(len(features), count, replace=False)]
    with warnings.catch_warnings():
        # A cluster that loses all its strands is left out by the caller.
        warnings.filterwarnings("ignore", "One of the clusters is empty")
        return kmeans2(features, start, iter=12, minit="matrix", missing="warn")[1]


def _closest(
    uv: Float[np.ndarray, "strands 2"], centre: Float[np.ndarray, "clusters 2"]
) -> Int[np.ndarray, " strands"]:
    return np.argmin(((uv[:, None] - centre[None]) ** 2).sum(axis=2), axis=1)


def star_reach(
    members: Float[np.ndarray, "strands 2"], least: float
) -> Float[np.ndarray, " 32"]:
    """Return the star-shaped border around roots, in 32 directions from 0."""
    distance = np.linalg.norm(members, axis=1)
    across = members @ spokes().T
    angle = np.arccos(np.clip(across / np.maximum(distance, 1e-12)[:, None], -1, 1))
    near = angle < 2.0 * np.pi / ANGLES
    return np.where(near, distance[:, None], 0.0).max(axis=0, initial=0.0) + least
