"""Fewer roots where strands leave the masks on their way, or run in loops.

Clusters follow the photographs in the mean, so that single strands arch out of the
hair, which one sees at once. Where strands grow that come so far out of a mask, fewer
do, but those stay that come out before the background alone and hide what nothing else
hides. Tips are taken back before, see `tips`. Where photographs tell little, clusters
may be wound up: of hair that does not curl, what runs in loops is scribble.
"""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from ..abreast import abreast
from ..evaluate.visibility import Sight
from ..host import on_device
from ..model.maps import ScalpMaps
from ..model.strand import Hair
from ..render.raster import cells, project_points
from ..types import along_paths
from .density import texel_means
from .thinning import MOST, block_of, covers, hidden_by, width_of

FREE = 1.5  # pixels of a photograph about its mask that may be hair as well
LOST = 0.002  # metres beyond these from which on a place is none of the hair's
# Curls may come farther out, by this share of their radius: nobody sees how each winds.
TURN = 0.5
# No strand stays of which so much is lost, fewer of which less is: long ones are right
# elsewhere.
MOST_LOST = 0.07
# What a strand hides that would be bare makes up for as much that is lost before the
# background, unless it comes out so far that one sees it. Metres.
SEEN_OUT = 0.003
# Where no strand is rooted those around tell: a Gaussian of so many texels.
BESIDE = 1.5
SPARSEST = 0.002  # a scalp where all strands come out still grows some
# A strand loops that comes less far than this share of so many metres of its length.
FORWARD, LOOP = 0.5, 0.02


def without_strays(
    maps: ScalpMaps, hair: Hair, sights: Sequence[Sight], radius: float
) -> ScalpMaps:
    """Return maps with a lower density of roots where strands come out or loop.

    Args:
        maps: What is on the scalp, with a density `TEXELS` a side.
        hair: Strands of these maps.
        sights: The photographs that count, one or more.
        radius: Of the strands' curls, in metres; 0 where they do not curl.
    """
    if not len(hair.uv):
        return maps
    points = np.asarray(hair.strands, np.float64)
    # One by one: the distances of all photographs at once would take much memory.
    seen = abreast(lambda one: comes_out(points, one), sights)
    out, aside = (one - TURN * radius for one in functools.reduce(farther, seen))
    lost, in_air = share_lost(out), share_lost(aside)
    some = np.flatnonzero((in_air > 0.0) & (out.max(axis=1) < SEEN_OUT))
    made_up = hides_bare(points, some, staying(lost), sights)
    lost[some] -= np.minimum(made_up, in_air[some])
    stays = staying(lost)
    if radius == 0.0:
        stays[comes_forward(points) < FORWARD] = 0.0
    uv = np.asarray(hair.uv, np.float64)
    count, mean = texel_means(uv, stays)
    around = texel_means(uv, stays, BESIDE)
    beside = np.where(around.count > 0.0, around.mean, 1.0)
    share = np.where(count > 0.0, mean, beside)
    density = np.asarray(maps.density, np.float64) * np.maximum(share, SPARSEST)
    return eqx.tree_at(
        lambda m: m.density, maps, on_device(density, maps.density.dtype)
    )


class Out(NamedTuple):
    """How far beyond `FREE` points come out of a photograph's hair, in metres.

    Attributes:
        anywhere: Before the head as well.
        in_air: Where nothing is behind them; else 0.
    """

    anywhere: Float[np.ndarray, "strands points"]
    in_air: Float[np.ndarray, "strands points"]


def comes_out(points: Float[np.ndarray, "strands points 3"], sight: Sight) -> Out:
    """Return how far points come out of a photograph's hair.

    Of what the head hides, or what is beyond the picture, nothing is said.

    Args:
        points: Points of strands, in metres.
        sight: The photograph, and what is behind its hair.
    """
    view, behind = sight
    if not view.hair.any():
        none = np.zeros(points.shape[:2])
        return Out(none, none)
    y, x, shows, depth = where_it_shows(points, sight)
    beside = np.asarray(ndimage.distance_transform_edt(~view.hair))[y, x]
    far = np.maximum(beside - FREE, 0.0) * depth / view.camera.focal
    far = np.where(shows, far, 0.0)
    return Out(far, far if behind is None else np.where(np.isinf(behind[y, x]), far, 0))


def farther(one: Out, other: Out) -> Out:
    """Return how far points come out where they come out farther."""
    return Out(*map(np.maximum, one, other))


def share_lost(
    out: Float[np.ndarray, "strands points"],
) -> Float[np.ndarray, " strands"]:
    """Return the share of each strand that is none of the hair's, by metres out."""
    return np.clip(out / LOST, 0.0, 1.0).mean(axis=1)


def staying(lost: Float[np.ndarray, " strands"]) -> Float[np.ndarray, " strands"]:
    """Return the share that stays of strands of which so much is lost."""
    return np.clip(1.0 - lost / MOST_LOST, 0.0, 1.0)


def hides_bare(
    points: Float[np.ndarray, "strands points 3"],
    some: Int[np.ndarray, " some"],
    stays: Float[np.ndarray, " strands"],
    sights: Sequence[Sight],
) -> Float[np.ndarray, " some"]:
    """Return the share of strands that lies before hair which the others leave bare.

    Bare is what they hide by less than half in a photograph, as wide as all of them
    cover the masks best.

    Args:
        points: Points of strands, in metres.
        some: The strands that are asked for.
        stays: The share of each strand that stays.
        sights: The photographs, one or more.
    """
    if not len(some):
        return np.zeros(0)
    step = -(-len(points) // MOST)
    seen = list(abreast(lambda one: covers(points[::step], one), sights))
    width = width_of(seen, stays[::step])
    hides = np.zeros((len(some), points.shape[1]), bool)
    for sight, (hidden, wanted) in zip(sights, seen, strict=True):
        bare = wanted & (hidden_by(hidden, stays[::step], width) < 1.0)
        y, x, shows, _ = where_it_shows(points[some], sight)
        hides |= shows & bare[block_of(y, x, sight.view.camera.width)]
    return hides.mean(axis=1)


class Places(NamedTuple):
    """Where points are in a photograph.

    Attributes:
        y, x: Their pixels; of those beyond the picture some other.
        shows: Whether they are in it and nothing but hair may hide them.
        depth: In metres.
    """

    y: Int[np.ndarray, "strands points"]
    x: Int[np.ndarray, "strands points"]
    shows: Bool[np.ndarray, "strands points"]
    depth: Float[np.ndarray, "strands points"]


def where_it_shows(
    points: Float[np.ndarray, "strands points 3"], sight: Sight
) -> Places:
    """Return where points of strands are in a photograph."""
    camera, behind = sight.view.camera, sight.behind
    pixels = project_points(points.reshape(-1, 3), camera)
    y, x, shows = cells(pixels, camera.width, camera.height)
    if behind is not None:
        shows &= pixels.depth < behind[y, x]
    shape = points.shape[:2]
    return Places(*(one.reshape(shape) for one in (y, x, shows, pixels.depth)))


def comes_forward(
    points: Float[np.ndarray, "strands points 3"],
) -> Float[np.ndarray, " strands"]:
    """Return how far strands come where they come least, as a share of their length.

    Over stretches of `LOOP`, as many segments of a strand at its mean step: near 1
    where it is straight, 0 where it comes back; 1 of strands that are shorter.

    Args:
        points: Points of strands, in metres.
    """
    along, most = along_paths(points), points.shape[1] - 1
    segments = np.rint(LOOP * most / np.maximum(along[:, -1], 1e-6)).astype(int)
    least = np.ones(len(points))
    for count in np.unique(segments[(segments > 0) & (segments <= most)]):
        rows = np.flatnonzero(segments == count)
        chord = points[rows, count:] - points[rows, :-count]
        arc = along[rows, count:] - along[rows, :-count]
        share = np.linalg.norm(chord, axis=2) / np.maximum(arc, 1e-9)
        least[rows] = share.min(axis=1)
    return least
