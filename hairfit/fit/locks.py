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
from jaxtyping import Array, Float, Int
from scipy import ndimage

from ..abreast import abreast
from ..capture.capture import View
from ..capture.orientation import OrientationMap
from ..host import on_device
from ..model.fur import Helix, curl_pitch, helix_of
from ..model.locks import Locks
from ..model.maps import fill, root_attributes
from ..model.strand import sample_hair
from ..model.tree import HairTree
from ..render import Camera, project_points
from ..render.raster import cells
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
    """Points of hair on the middle lines of its curls, and the helices about these.

    Attributes:
        middle: The points, in metres.
        tangent: Unit direction of the line there.
        normal: Where the helix is at an angle of 0, a unit vector across the line.
        binormal: Where it is at a right angle.
        angle: By which the helix has turned, in radians.
        size: Its radius, in metres.
        slope: Metres that it goes across for each metre along.
        place: Which knot of all clusters' is next to the point.
    """

    middle: Float[np.ndarray, "points 3"]
    tangent: Float[np.ndarray, "points 3"]
    normal: Float[np.ndarray, "points 3"]
    binormal: Float[np.ndarray, "points 3"]
    angle: Float[np.ndarray, " points"]
    size: Float[np.ndarray, " points"]
    slope: Float[np.ndarray, " points"]
    place: Int[np.ndarray, " points"]


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
        tree: A tree whose maps say how large curls are.
        curls: How curly the hair is.
        shots: The photographs.
        maps: Orientation maps of all of them.
        points: Points of a strand, some 8 for each turn.
        seed: Of what photographs do not tell.
    """
    if curls.radius == 0.0 or not curls.told:
        return tree
    used = [maps[k] for k in shots.used]
    pitch = curls.pitch / curls.radius
    locks = find_locks(tree, shots.views, used, pitch, points, seed)
    return dataclasses.replace(tree, locks=locks)


def find_locks(
    tree: HairTree,
    views: Sequence[View],
    maps: Sequence[OrientationMap],
    pitch: float,
    points: int,
    seed: int,
) -> Locks:
    """Return how the curls of a tree's clusters wind.

    Args:
        tree: A tree whose maps say how large curls are.
        views: The photographs.
        maps: Their orientation maps, of hair, not of locks.
        pitch: Length of a turn, in radii.
        points: Points of a strand, some 8 for each turn.
        seed: Of what photographs do not tell.
    """
    knots = tree.cylinder.skeleton.shape[1]
    rng = np.random.default_rng(seed)
    phase = np.tile(rng.uniform(0.0, 2.0 * np.pi, (tree.count, 1)), (1, knots))
    hand = rng.choice(HANDS, tree.count)
    turns = find_turns(tree, pitch, points, seed)
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
    found = phase, hand, np.full(tree.count, pitch)
    return Locks(*(on_device(one, jnp.float32) for one in found))


def find_turns(tree: HairTree, per_radius: float, points: int, seed: int) -> Turns:
    """Return hair of a tree as what its curls wind about."""
    maps = tree.maps
    assert maps is not None
    bare = dataclasses.replace(maps, curl=fill(maps.curl, 0.0))
    tree = dataclasses.replace(tree, maps=bare, locks=None)
    hair = sample_hair(tree, STRANDS, points, jax.random.key(seed))
    radius = root_attributes(maps, hair.uv).curl.astype(hair.strands.dtype)
    pitch = curl_pitch(radius, per_radius)
    helix = helices(hair.strands, radius, pitch)
    knots = tree.cylinder.skeleton.shape[1]
    share = np.asarray(hair.eta)[:, None] * np.linspace(0.0, 1.0, points)
    knot = np.clip(np.rint(share * (knots - 1)).astype(int), 0, knots - 1)
    middle, tangent, normal, binormal = (
        np.asarray(one).reshape(-1, 3) for one in (hair.strands, *helix.frames)
    )
    size = np.asarray(helix.size)
    return Turns(
        middle,
        tangent,
        normal,
        binormal,
        np.asarray(helix.angle).ravel(),
        size.ravel(),
        (2.0 * np.pi * size / np.asarray(pitch)[:, None]).ravel(),
        (np.asarray(hair.owner)[:, None] * knots + knot).ravel(),
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
    height, width = found.confidence.shape
    pixels = project_points(turns.middle, camera)
    row, column, inside = cells(pixels, width, height)
    # The front of a turn stands before the middle.
    nearest = pixels.depth - turns.size
    front = np.full((height, width), np.inf)
    np.minimum.at(front, (row[inside], column[inside]), nearest[inside])
    front = ndimage.minimum_filter(front, 2 * SPLAT + 1)
    near = inside & (nearest < front[row, column] + BEHIND)
    some = Turns(*(one[near] for one in turns))
    told = np.zeros((len(HANDS), PHASES, shape[0] * shape[1]))
    count = np.zeros(shape[0] * shape[1])
    for h, hand in enumerate(HANDS):
        for k in range(PHASES):
            turn = 2.0 * np.pi * k / PHASES + hand * some.angle
            cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
            out = cosine * some.normal + sine * some.binormal
            across = hand * (cosine * some.binormal - sine * some.normal)
            at = some.middle + some.size[:, None] * out
            goes = some.tangent + some.slope[:, None] * across
            pixels = project_points(at, camera)
            ahead = project_points(at + AHEAD * goes, camera).pixel - pixels.pixel
            row, column, inside = cells(pixels, width, height)
            seen = inside & (pixels.depth < front[row, column] + BEHIND)
            # What runs towards the camera is short in the picture and says less.
            length = np.linalg.norm(ahead, axis=1)
            weight = found.confidence[row, column] * seen * length
            off = np.arctan2(ahead[:, 1], ahead[:, 0]) - found.angle[row, column]
            agree = weight * np.cos(2.0 * off)
            told[h, k] = np.bincount(some.place, agree, minlength=told.shape[2])
            count += np.bincount(some.place, weight, minlength=told.shape[2])
    count /= len(HANDS) * PHASES
    return Answer(told.reshape(*told.shape[:2], *shape), count.reshape(shape))


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
