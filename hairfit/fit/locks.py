"""How locks of curls wind: hand and phase of each cluster's curls, from photographs.

Curls of hair that photographs see show as the front of each turn, which slopes one way
for curls that wind to the right and the other way for those that wind to the left. For
each cluster the hand and, along it, the phase are found whose turns lie best on the
orientation maps; the phase may drift, as a pitch is never quite right. Clusters that no
photograph sees wind at random.
"""

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..capture.orientation import OrientationMap
from ..host import on_device
from ..model.fur import PITCH, Helix, curl_pitch, helix_of
from ..model.locks import Locks
from ..model.maps import fill
from ..model.strand import sample_hair
from ..model.tree import HairTree
from ..render import Camera
from .curls import Curls
from .shots import Shots

STRANDS = 4000  # of all clusters, by which their locks are compared
PHASES = 12  # that are tried, even about the hair
HANDS = (1.0, -1.0)
# What is no deeper than this behind the foremost hair is seen, in metres.
BEHIND = 0.005
AHEAD = 1e-3  # metres by which the direction in a picture is found
SPLAT = 3  # pixels around a point of hair that it hides
# A step of the phase from knot to knot costs as much as full disagreement of the hair
# along so many knots, of a lock that is seen as the median one.
DRIFT = 1.0


class Turns(NamedTuple):
    """Hair as middle lines, and the helices that wind about them.

    Attributes:
        middle: The lines, in metres.
        tangent: Their unit directions.
        helix: How each of them winds.
        owner: The cluster of each.
        knot: The knot of the cluster that is next to each point.
    """

    middle: Float[np.ndarray, "strands points 3"]
    tangent: Float[np.ndarray, "strands points 3"]
    helix: Helix
    owner: Int[np.ndarray, " strands"]
    knot: Int[np.ndarray, "strands points"]


class Paths(NamedTuple):
    """The best way of each cluster's phase from its root to its tip.

    Attributes:
        phase: Index of the phase at each knot.
        score: What it scores.
    """

    phase: Int[np.ndarray, "clusters knots"]
    score: Float[np.ndarray, " clusters"]


def with_locks(
    tree: HairTree,
    curls: Curls,
    shots: Shots,
    maps: Sequence[OrientationMap],
    points: int,
    seed: int,
) -> HairTree:
    """Return the tree with its locks, or as it is where no curls are seen.

    Args:
        tree: A tree whose maps say how large curls are, all over the scalp.
        curls: How curly the hair is.
        shots: The photographs.
        maps: Orientation maps of all of them.
        points: Points of a strand, some 8 for each turn.
        seed: Of what photographs do not tell.
    """
    if curls.radius == 0.0 or not curls.told:
        return tree
    used = [maps[k] for k in shots.used]
    locks = find_locks(tree, shots.views, used, points, seed)
    return dataclasses.replace(tree, locks=locks)


def find_locks(
    tree: HairTree,
    views: Sequence[View],
    maps: Sequence[OrientationMap],
    points: int,
    seed: int,
) -> Locks:
    """Return how the curls of a tree's clusters wind.

    Args:
        tree: A tree whose maps say how large curls are, all over the scalp.
        views: The photographs.
        maps: Their orientation maps, of hair, not of locks.
        points: Points of a strand, some 8 for each turn.
        seed: Of what photographs do not tell.
    """
    knots = tree.cylinder.skeleton.shape[1]
    rng = np.random.default_rng(seed)
    phase = np.tile(rng.uniform(0.0, 2.0 * np.pi, (tree.count, 1)), (1, knots))
    hand = rng.choice(HANDS, tree.count)
    turns = find_turns(tree, points, seed)
    each = abreast(
        partial(ask_view, turns, (tree.count, knots)),
        [view.camera for view in views],
        maps,
    )
    told, count = (np.sum(parts, axis=0) for parts in zip(*each, strict=True))
    seen = np.flatnonzero(count.sum(axis=1) > 0.0)
    if len(seen):
        cost = DRIFT * float(np.median(count[seen].sum(axis=1))) / knots
        paths = [best_paths(one[:, seen], cost) for one in told]
        best = np.argmax([path.score for path in paths], axis=0)
        steps = np.stack([path.phase for path in paths])[best, np.arange(len(seen))]
        phase[seen] = np.unwrap(2.0 * np.pi / PHASES * steps, axis=1)
        hand[seen] = np.asarray(HANDS)[best]
    return Locks(on_device(phase, jnp.float32), on_device(hand, jnp.float32))


def find_turns(tree: HairTree, points: int, seed: int) -> Turns:
    """Return hair of a tree as what its curls wind about."""
    maps = tree.maps
    assert maps is not None
    radius = float(np.asarray(maps.curl).max())
    bare = dataclasses.replace(maps, curl=fill(maps.curl, 0.0))
    tree = dataclasses.replace(tree, maps=bare, locks=None)
    hair = sample_hair(tree, STRANDS, points, jax.random.key(seed))
    radii = jnp.full(len(hair.strands), radius, hair.strands.dtype)
    helix = jax.tree.map(np.asarray, helices(hair.strands, radii, curl_pitch(radii)))
    share = np.asarray(hair.eta)[:, None] * np.linspace(0.0, 1.0, points)
    knots = tree.cylinder.skeleton.shape[1]
    knot = np.clip(np.rint(share * (knots - 1)).astype(int), 0, knots - 1)
    middle = np.asarray(hair.strands)
    return Turns(
        middle, np.asarray(helix.frames.tangent), helix, np.asarray(hair.owner), knot
    )


@jax.jit
def helices(
    strands: Float[Array, "strands points 3"],
    radius: Float[Array, " strands"],
    pitch: Float[Array, " strands"],
) -> Helix:
    """Return what winds about each of many strands, see `helix_of`."""
    return jax.vmap(helix_of)(strands, radius, pitch)


class Answer(NamedTuple):
    """What photographs say of each hand and phase of each cluster at its knots.

    Agreement is the cosine of twice the angle between a turn and the map, weighted by
    its confidence: 1 along it, -1 across.

    Attributes:
        told: Sums of agreement.
        count: Sums of weights, in the mean of all hands and phases.
    """

    told: Float[np.ndarray, "hands phases clusters knots"]
    count: Float[np.ndarray, "clusters knots"]


def ask_view(
    turns: Turns, shape: tuple[int, int], camera: Camera, found: OrientationMap
) -> Answer:
    """Return what one photograph says.

    Args:
        turns: The hair.
        shape: Numbers of clusters and of their knots.
        camera: Of the photograph.
        found: Its orientation map.
    """
    size, angle = np.asarray(turns.helix.size), np.asarray(turns.helix.angle)
    frames = turns.helix.frames
    pixel, depth = pixels_of(camera, turns.middle)
    row, column, inside = rows_of_pixels(pixel, found.confidence.shape)
    front = np.full(found.confidence.shape, np.inf)
    # The front of a turn stands before the middle.
    nearest = (depth - size)[inside]
    np.minimum.at(front, (row[inside], column[inside]), nearest)
    front = ndimage.minimum_filter(front, 2 * SPLAT + 1)
    near = inside & (depth - size < front[row, column] + BEHIND)
    place = np.nonzero(near)
    where = turns.owner[place[0]] * shape[1] + turns.knot[place]
    centre, along, size, angle = (
        one[place] for one in (turns.middle, turns.tangent, size, angle)
    )
    normal, binormal = (
        np.asarray(one)[place] for one in (frames.normal, frames.binormal)
    )
    told = np.zeros((len(HANDS), PHASES, shape[0] * shape[1]))
    count = np.zeros(shape[0] * shape[1])
    for h, hand in enumerate(HANDS):
        for k in range(PHASES):
            turn = 2.0 * np.pi * k / PHASES + hand * angle
            cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
            at = centre + size[:, None] * (cosine * normal + sine * binormal)
            slope = hand * 2.0 * np.pi / PITCH * (size / size.max(initial=1e-9))
            goes = along + slope[:, None] * (cosine * binormal - sine * normal)
            pixel, depth = pixels_of(camera, at)
            ahead = pixels_of(camera, at + AHEAD * goes).pixel - pixel
            row, column, inside = rows_of_pixels(pixel, front.shape)
            seen = inside & (depth < front[row, column] + BEHIND)
            # What runs towards the camera is short in the picture and says less.
            length = np.linalg.norm(ahead, axis=1)
            weight = found.confidence[row, column] * seen * length
            off = np.arctan2(ahead[:, 1], ahead[:, 0]) - found.angle[row, column]
            agree = weight * np.cos(2.0 * off)
            told[h, k] += np.bincount(where, agree, minlength=told.shape[2])
            count += np.bincount(where, weight, minlength=told.shape[2])
    count /= len(HANDS) * PHASES
    return Answer(told.reshape(*told.shape[:2], *shape), count.reshape(shape))


class Landed(NamedTuple):
    """Where points land in a photograph: pixels, and depth in metres."""

    pixel: Float[np.ndarray, "*points 2"]
    depth: Float[np.ndarray, "*points"]


def pixels_of(camera: Camera, points: Float[np.ndarray, "*points 3"]) -> Landed:
    """Return where many points land."""
    turn = np.asarray(camera.cam_from_world, np.float64)
    seen = points @ turn[:3, :3].T + turn[:3, 3]
    flat = seen @ np.asarray(camera.K, np.float64).T
    return Landed(flat[..., :2] / np.maximum(flat[..., 2:], 1e-9), seen[..., 2])


class Pixels(NamedTuple):
    """Indices of pixels, and which of them are in the picture."""

    row: Int[np.ndarray, "*points"]
    column: Int[np.ndarray, "*points"]
    inside: Bool[np.ndarray, "*points"]


def rows_of_pixels(
    pixel: Float[np.ndarray, "*points 2"], shape: tuple[int, ...]
) -> Pixels:
    """Return the pixels that hold points, the nearest of the border for those out."""
    index = np.floor(pixel).astype(int)
    row, column = (
        np.clip(index[..., axis], 0, size - 1)
        for axis, size in zip((1, 0), shape, strict=True)
    )
    return Pixels(row, column, (index[..., 1] == row) & (index[..., 0] == column))


def best_paths(told: Float[np.ndarray, "phases clusters knots"], cost: float) -> Paths:
    """Return phases along clusters that agree most, less the cost of their steps.

    From knot to knot a phase stays or goes on to the next or the last one, by dynamic
    programming [Bellman 1957].

    Args:
        told: Agreement of each phase at each knot.
        cost: Of a step to another phase.
    """
    phases, clusters, knots = told.shape
    score, came = told[..., 0], []
    for knot in range(1, knots):
        ways = np.stack(
            [np.roll(score, 1, 0) - cost, score, np.roll(score, -1, 0) - cost]
        )
        came.append(ways.argmax(axis=0) - 1)
        score = ways.max(axis=0) + told[..., knot]
    phase = np.zeros((clusters, knots), int)
    phase[:, -1] = score.argmax(axis=0)
    for knot in range(knots - 1, 0, -1):
        at = phase[:, knot]
        phase[:, knot - 1] = (at + came[knot - 1][at, np.arange(clusters)]) % phases
    return Paths(phase, score.max(axis=0))
