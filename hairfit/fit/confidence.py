"""How sure a fit is of each cluster: the normal equations of its skeleton, inverted.

The unknowns of a cluster are how far each knot of its skeleton is off, in the two
directions across it; its root stands. What photographs tell of them (`sightings`) is
added to what is held of all hair (`unseen`): it bends little, runs as the hair beside
it does, lies inside of the masks, and stays by the cluster that it belongs to, which
photographs may know better. Each is counted in units of its own standard deviation, so
the sum is an information matrix and its inverse the covariance of the fit.
"""

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ..abreast import abreast
from ..capture.capture import View
from ..capture.orientation import OrientationMap
from ..host import on_device
from ..model.certainty import TreeConfidence
from ..model.cylinder import frames_of
from ..model.tree import HairTree, leaves, levels
from .residuals import seen_segments
from .samples import Samples, sampled_strands
from .sightings import Told, outline_distance, pieces_of, scatter, tell
from .unseen import find_room, place_variance, turn_variance

# A skeleton's stretch is held to be as long as this at least. Metres.
SHORTEST = 1e-4
# Hair is never held to run as the hair around it by less than this. Radians.
LEAST_TURN = 0.01


@dataclasses.dataclass(frozen=True)
class ConfidenceConfig:
    """What is held of all hair: standard deviations in metres."""

    points: int = 24
    """Points of the strands that are compared with the photographs."""
    sigma_bend: float = 0.002
    """How far a knot is off the middle of those beside it."""
    sigma_stay: float = 0.01
    """How far a knot is off where the cluster above puts it."""
    sigma_hull: float = 0.004
    """How far the hair's surface is below what masks leave for it."""
    spacing: float = 0.0005
    """How far apart hair is inside."""


class Evidence(NamedTuple):
    """What is known of each stretch of each cluster, as means over its hair.

    Attributes:
        photographs: Information on the moves of its two knots, of all photographs.
        turn: Squared error of its direction as the hair around has it.
        place: Information of the masks on where it lies.
        scatter: Squared error of the direction of a cluster's single hairs.
    """

    photographs: Float[np.ndarray, "clusters stretches 6 6"]
    turn: Float[np.ndarray, "clusters stretches"]
    place: Float[np.ndarray, "clusters stretches 3 3"]
    scatter: Float[np.ndarray, " clusters"]


def with_confidence(
    tree: HairTree,
    samples: Samples,
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    maps: Sequence[OrientationMap],
    config: ConfidenceConfig | None = None,
    *,
    room: int = 0,
) -> HairTree:
    """Return the tree that says how sure the photographs make each of its clusters.

    Args:
        tree: A tree of any number of levels, as it was fitted.
        samples: Strands of it, each owned by a leaf, some for each leaf.
        views: The photographs.
        depths: Depth of the head in them, in metres.
        maps: Their orientation maps.
        config: What is held of all hair.
        room: Arrays hold so many clusters, if the tree has fewer: `sampled_strands`.

    Raises:
        ValueError: If there is no strand or no photograph.
    """
    if not len(samples.owner) or not len(views):
        raise ValueError("confidence needs at least one strand and one photograph.")
    config = config or ConfidenceConfig()
    evidence = find_evidence(tree, samples, views, depths, maps, config, room)
    confidence = solve(tree, evidence, config)
    return dataclasses.replace(tree, confidence=confidence)


def find_evidence(
    tree: HairTree,
    samples: Samples,
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    maps: Sequence[OrientationMap],
    config: ConfidenceConfig,
    room: int = 0,
) -> Evidence:
    """Return what photographs tell, and what is held, of each stretch."""
    strands = sampled_strands(tree, samples, config.points, room)
    knots = tree.cylinder.skeleton.shape[1]
    pieces = pieces_of(strands, np.asarray(samples.owner), tree.count, knots)
    seen = seen_segments(strands, views, depths).reshape(len(views), -1)
    within = list(abreast(outline_distance, views))
    every = abreast(partial(tell, pieces), views, maps, within, seen)
    told = Told(*(np.sum(parts, axis=0) for parts in zip(*every, strict=True)))
    turn = turn_variance(pieces, np.any(seen, axis=0))
    free = find_room(pieces, views, depths, within)
    variance = place_variance(free.deep, config.sigma_hull, config.spacing)
    place = pieces.totals(free.across / variance[:, None, None])
    count = with_descendants(tree, pieces.total(np.ones(len(turn))))
    some = np.maximum(count, 1.0)
    told = Told(*(with_descendants(tree, part) for part in told))
    turns = with_descendants(tree, pieces.total(turn)) / some
    return Evidence(
        told.info / some[..., None, None],
        np.where(count > 0, turns, turn.max()),
        with_descendants(tree, place) / some[..., None, None],
        scatter(told, config.points),
    )


def with_descendants(
    tree: HairTree, values: Float[np.ndarray, "clusters ..."]
) -> Float[np.ndarray, "clusters ..."]:
    """Return sums over each cluster and all below it."""
    total = np.array(values)
    for i in range(tree.count - 1, -1, -1):
        if tree.parent[i] >= 0:
            total[tree.parent[i]] += total[i]
    return total


def solve(
    tree: HairTree, evidence: Evidence, config: ConfidenceConfig
) -> TreeConfidence:
    """Return the confidence of all clusters, from that of the clusters above on."""
    skeleton = np.asarray(tree.cylinder.skeleton, np.float64)
    step = np.linalg.norm(np.diff(skeleton, axis=1), axis=2)
    step = np.maximum(step, SHORTEST)
    basis = across(tree)
    eye = np.eye(3)
    apart, middle = np.array([[1, -1], [-1, 1]]), np.full((2, 2), 0.25)
    turn = 1.0 / (np.maximum(evidence.turn, LEAST_TURN**2) * step**2)
    photographs = system(basis, evidence.photographs)
    held = system(basis, np.kron(apart, eye) * turn[..., None, None])
    held += stiffness(basis) / config.sigma_bend**2
    place = np.einsum("ab,ckxy->ckaxby", middle, evidence.place)
    place = system(basis, place.reshape(evidence.photographs.shape))
    size = held.shape[-1]
    covariance, share = np.zeros_like(held), np.zeros(tree.count)
    for row in levels(tree):
        # The share first: masks bound where hair lies, but show nothing of its way.
        above = np.asarray(tree.parent)[row]
        stay = np.tile(config.sigma_stay**2 * np.eye(size), (len(row), 1, 1))
        if above[0] >= 0:
            stay += carried(covariance[above], basis[above], basis[row])
        prior = np.linalg.inv(stay) + held[row]
        shown = np.linalg.inv(prior + photographs[row])
        share[row] = np.einsum("cij,cji->c", shown, photographs[row]) / size
        covariance[row] = np.linalg.inv(prior + photographs[row] + place[row])
    errors = knot_errors(covariance, basis, step)
    angle = errors.angle + evidence.scatter
    position, angle, share = (
        mean_of_leaves(tree, values) for values in (errors.position, angle, share)
    )
    found = np.sqrt(position), np.sqrt(angle), np.clip(share, 0.0, 1.0)
    return TreeConfidence(*(on_device(values, jnp.float32) for values in found))


def across(tree: HairTree) -> Float[np.ndarray, "clusters knots 3 2"]:
    """Return the two directions across each cluster at each knot."""
    frames = frames_of(tree.cylinder)
    return np.stack(
        [np.asarray(frames.normal, np.float64), np.asarray(frames.binormal)], axis=-1
    )


def system(
    basis: Float[np.ndarray, "clusters knots 3 2"],
    info: Float[np.ndarray, "clusters stretches 6 6"],
) -> Float[np.ndarray, "clusters moves moves"]:
    """Return information on the moves of the knots of each stretch as one matrix."""
    clusters, knots = basis.shape[:2]
    whole = np.zeros((clusters, knots, 2, knots, 2))
    parts = info.reshape(clusters, knots - 1, 2, 3, 2, 3)
    for a in (0, 1):
        for b in (0, 1):
            first, second = basis[:, a : knots - 1 + a], basis[:, b : knots - 1 + b]
            some = np.einsum(
                "ckxi,ckxy,ckyj->kcij", first, parts[:, :, a, :, b], second
            )
            k = np.arange(knots - 1)
            whole[:, k + a, :, k + b] += some
    return without_root(whole)


def without_root(
    whole: Float[np.ndarray, "clusters knots 2 knots 2"],
) -> Float[np.ndarray, "clusters moves moves"]:
    """Return matrices over the knots that can move, all but the first."""
    clusters, knots = whole.shape[:2]
    size = 2 * (knots - 1)
    return whole[:, 1:, :, 1:].reshape(clusters, size, size)


def stiffness(
    basis: Float[np.ndarray, "clusters knots 3 2"],
) -> Float[np.ndarray, "clusters moves moves"]:
    """Return the squares of how far knots are off the middle of those beside them."""
    knots = basis.shape[1]
    bend = np.eye(knots) - 0.5 * (np.eye(knots, k=1) + np.eye(knots, k=-1))
    square = bend[1:-1].T @ bend[1:-1]
    whole = np.einsum("cixa,ij,cjxb->ciajb", basis, square, basis)
    return without_root(whole)


def carried(
    covariance: Float[np.ndarray, "clusters moves moves"],
    parent: Float[np.ndarray, "clusters knots 3 2"],
    child: Float[np.ndarray, "clusters knots 3 2"],
) -> Float[np.ndarray, "clusters moves moves"]:
    """Return the covariance that children take over from the clusters above them."""
    clusters, knots = child.shape[:2]
    turn = np.einsum("ckxa,ckxb->ckab", child, parent)[:, 1:]
    parts = covariance.reshape(clusters, knots - 1, 2, knots - 1, 2)
    parts = np.einsum("ciab,cibjd->ciajd", turn, parts)
    parts = np.einsum("ciajd,cjed->ciaje", parts, turn)
    return parts.reshape(covariance.shape)


class Errors(NamedTuple):
    """Squared errors to expect in each direction across, as means over a cluster."""

    position: Float[np.ndarray, " clusters"]
    angle: Float[np.ndarray, " clusters"]


def knot_errors(
    covariance: Float[np.ndarray, "clusters moves moves"],
    basis: Float[np.ndarray, "clusters knots 3 2"],
    step: Float[np.ndarray, "clusters stretches"],
) -> Errors:
    """Return the squared errors of knots, and of the directions between them."""
    clusters, knots = basis.shape[:2]
    whole = np.zeros((clusters, knots, 2, knots, 2))
    parts = covariance.reshape(clusters, knots - 1, 2, knots - 1, 2)
    whole[:, 1:, :, 1:] = parts
    own = np.einsum("ckaka->ck", whole)
    k = np.arange(knots - 1)
    beside = whole[:, k, :, k + 1]
    both = np.einsum("kcab,ckxa,ckxb->ck", beside, basis[:, :-1], basis[:, 1:])
    turned = (own[:, 1:] + own[:, :-1] - 2.0 * both) / step**2
    return Errors(0.5 * own[:, 1:].mean(axis=1), 0.5 * turned.mean(axis=1))


def mean_of_leaves(
    tree: HairTree, values: Float[np.ndarray, " clusters"]
) -> Float[np.ndarray, " clusters"]:
    """Return each leaf's value, and for other clusters the mean of the leaves below."""
    leaf = np.zeros(tree.count)
    leaf[leaves(tree)] = 1.0
    return with_descendants(tree, leaf * values) / with_descendants(tree, leaf)
