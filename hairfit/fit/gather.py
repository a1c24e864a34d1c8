"""Strands gathered into the clusters that say them best: bottom-up [Kim02, 7.5]."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..render.raster import unit
from .cluster import kmeans

# What counts as error besides the mean square distance of a strand's knots: so many
# times its root's squared distance from the cluster's middle, with up to so many
# clusters. So clusters are pieces of scalp, and roots sampled anew find the cluster
# that is theirs; of many, each is a small piece already (benchmarks/treeify.py).
COMPACT, COMPACT_CLUSTERS = 4.0, 100
ROOT_WEIGHT, UPPER_ROOT_WEIGHT = 2.0, 20.0
# Strands are outliers from so many times the median squared error on, and not closer to
# their cluster's than this in metres.
OUTLIER_SHARE, SMALLEST_OUTLIER = 2.0, 0.002
ROBUST_STEPS = 3
# So many strands at the typical distance weigh as much as the prior of the slopes.
PRIOR_STRANDS = 0.5
CHUNK = 4096


class Rooted(NamedTuple):
    """Strands on a scalp, as many knots each.

    Attributes:
        uv: Roots in scalp space.
        knots: Knots, in metres; the first ones lie on the scalp.
        ground: How the scalp's point moves with u and v at each root.
    """

    uv: Float[np.ndarray, "strands 2"]
    knots: Float[np.ndarray, "strands knots 3"]
    ground: Float[np.ndarray, "strands 3 2"]


class Maps(NamedTuple):
    """What clusters say of their strands: linear in the root's place.

    Attributes:
        middle: Mean (u, v) of the roots.
        curve: Mean strand, in metres.
        slope: How the strand's knots move with u and v.
    """

    middle: Float[np.ndarray, "clusters 2"]
    curve: Float[np.ndarray, "clusters knots 3"]
    slope: Float[np.ndarray, "clusters knots 3 2"]


def gather_strands(
    rooted: Rooted, count: int, *, rounds: int, seed: int
) -> Int[np.ndarray, " strands"]:
    """Return the cluster of each strand, numbered from 0 without gaps.

    After k-means strands go, round by round, to the cluster whose linear map of the
    root's place comes closest to them: k-means with planes in place of points.

    Args:
        rooted: The strands.
        count: Number of clusters wanted; fewer come back if some lose all strands.
        rounds: Rounds after k-means.
        seed: Of k-means.
    """
    features = rooted.knots.astype(np.float32)
    features[:, 0] *= ROOT_WEIGHT
    features = features.reshape(len(features), -1)
    label = numbered(kmeans(features, count, np.random.default_rng(seed)))
    weight = np.ones(len(label))
    for _ in range(rounds):
        maps = regress_maps(rooted, label, weight)
        label = closest_maps(rooted, maps)
        weight = robust_weight(rooted, maps, label)
        label = numbered(label)
    return label


def gather_upwards(maps: Maps, count: int, seed: int) -> Int[np.ndarray, " clusters"]:
    """Return the cluster above each cluster, numbered from 0 without gaps.

    The place on the scalp counts more than below: siblings share a piece of scalp.

    Args:
        maps: What the clusters say.
        count: Number of clusters above, at most.
        seed: Of k-means.
    """
    features = maps.curve.copy()
    features[:, 0] *= UPPER_ROOT_WEIGHT
    features = features.reshape(len(features), -1)
    return numbered(kmeans(features, count, np.random.default_rng(seed)))


def robust_maps(rooted: Rooted, label: Int[np.ndarray, " strands"]) -> Maps:
    """Return the maps of clusters in which strands that run elsewhere count little."""
    maps = regress_maps(rooted, label)
    for _ in range(ROBUST_STEPS):
        maps = regress_maps(rooted, label, robust_weight(rooted, maps, label))
    return maps


def robust_weight(
    rooted: Rooted, maps: Maps, label: Int[np.ndarray, " strands"]
) -> Float[np.ndarray, " strands"]:
    """Return Geman-McClure weights about what the maps say."""
    rest = follow_maps(maps, rooted.uv, label) - rooted.knots
    error = np.einsum("skx,skx->s", rest, rest) / rest.shape[1]
    scale = max(OUTLIER_SHARE * float(np.median(error)), SMALLEST_OUTLIER**2)
    return 1.0 / (1.0 + error / scale) ** 2


def numbered(label: Int[np.ndarray, " strands"]) -> Int[np.ndarray, " strands"]:
    """Return labels without those that nothing has."""
    return np.unique(label, return_inverse=True)[1]


def regress_maps(
    rooted: Rooted,
    label: Int[np.ndarray, " strands"],
    weight: Float[np.ndarray, " strands"] | None = None,
) -> Maps:
    """Return each cluster's mean strand and slopes, by least squares.

    At the scalp the slopes are the scalp's own. From knot to knot they are held to
    those before, so that a cluster of few strands keeps the width of its roots.

    Args:
        rooted: The strands.
        label: Cluster of each strand, from 0 without gaps.
        weight: How much each strand counts, above 0; 1 by default.
    """
    order = np.argsort(label, kind="stable")
    first = np.searchsorted(label[order], np.arange(label.max() + 1))
    w = np.ones(len(label)) if weight is None else weight[order]
    total = np.add.reduceat(w, first)
    share = w / total[label[order]]

    def mean(values):
        columns = share.reshape(-1, *[1] * (values.ndim - 1))
        return np.add.reduceat(columns * values, first)

    uv, knots = rooted.uv[order], rooted.knots[order]
    middle, curve = mean(uv), mean(knots)
    mine = label[order]
    away, rest = uv - middle[mine], knots - curve[mine]
    spread = mean(away[:, :, None] * away[:, None, :])
    product = np.stack([mean(rest * away[:, k, None, None]) for k in (0, 1)], axis=-1)
    typical = np.trace(spread, axis1=1, axis2=2) / 2 + 1e-9
    count = np.diff(np.append(first, len(label)))
    prior = (typical * PRIOR_STRANDS / count)[:, None, None]
    inverse = np.linalg.inv(spread + prior * np.eye(2))
    slope = np.empty((*curve.shape, 2))
    slope[:, 0] = mean(rooted.ground[order])
    for knot in range(1, curve.shape[1]):
        slope[:, knot] = (product[:, knot] + prior * slope[:, knot - 1]) @ inverse
    return Maps(middle, curve, across(curve, slope))


def across(
    curve: Float[np.ndarray, "clusters knots 3"],
    slope: Float[np.ndarray, "clusters knots 3 2"],
) -> Float[np.ndarray, "clusters knots 3 2"]:
    """Return slopes without what runs along the strands, but at the scalp.

    A generalized cylinder has no more than its cross-sections [Kim02, equation (4-4)].
    """
    tangent = unit(np.gradient(curve, axis=1))
    along = np.einsum("gkx,gkxi->gki", tangent, slope)
    along[:, 0] = 0.0
    return slope - tangent[..., None] * along[:, :, None, :]


def follow_maps(
    maps: Maps, uv: Float[np.ndarray, "strands 2"], label: Int[np.ndarray, " strands"]
) -> Float[np.ndarray, "strands knots 3"]:
    """Return the strands that clusters say for roots."""
    away = uv - maps.middle[label]
    return maps.curve[label] + np.einsum("skxi,si->skx", maps.slope[label], away)


def closest_maps(rooted: Rooted, maps: Maps) -> Int[np.ndarray, " strands"]:
    """Return the cluster whose map comes closest to each strand.

    The squared distance of a strand from what a map says is linear in products of the
    strand, its root and the map: one matrix product compares all with all.
    """
    clusters, knots = maps.curve.shape[:2]
    slope = maps.slope.reshape(clusters, -1, 2)
    start = maps.curve.reshape(clusters, -1) - np.einsum(
        "gdi,gi->gd", slope, maps.middle
    )
    linear = np.stack([start, slope[..., 0], slope[..., 1]], axis=1)
    square = np.einsum("gid,gjd->gij", linear, linear)
    ground = maps.curve[:, 0]
    compact = COMPACT * min(1.0, (COMPACT_CLUSTERS / clusters) ** 0.5)
    by_map = np.concatenate(
        [
            -2.0 * linear.reshape(clusters, -1),
            square.reshape(clusters, -1),
            -2.0 * knots * compact * ground,
            knots * compact * (ground**2).sum(axis=1, keepdims=True),
        ],
        axis=1,
    )
    by_map = np.ascontiguousarray(by_map.T, np.float32)
    label = np.empty(len(rooted.uv), int)
    for i in range(0, len(label), CHUNK):
        some = slice(i, i + CHUNK)
        flat = rooted.knots[some].reshape(-1, 3 * knots)
        one = np.ones((len(flat), 1))
        phi = np.concatenate([one, rooted.uv[some]], axis=1)
        by_strand = np.concatenate(
            [
                (phi[:, :, None] * flat[:, None, :]).reshape(len(flat), -1),
                (phi[:, :, None] * phi[:, None, :]).reshape(len(flat), -1),
                flat[:, :3],
                one,
            ],
            axis=1,
        )
        label[some] = np.argmin(by_strand.astype(np.float32) @ by_map, axis=1)
    return label
