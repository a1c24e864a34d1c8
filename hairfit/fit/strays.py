"""Fewer roots where strands leave the masks on their way, or run in loops.

Clusters follow the photographs in the mean, so that single strands arch out of the
hair, which one sees at once. Where strands grow that come so far out of a mask, fewer
do. Tips are taken back before, see `tips`. Where photographs tell little, clusters may
be wound up: of hair that does not curl, what runs in loops is scribble.
"""

import functools
from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Float
from scipy import ndimage

from ..abreast import abreast
from ..evaluate.visibility import Sight
from ..host import on_device
from ..model.maps import ScalpMaps
from ..model.strand import Hair
from ..render.raster import cells, project_points
from ..types import along_paths
from .density import texel_means

FREE = 1.5  # pixels of a photograph about its mask that may be hair as well
LOST = 0.002  # metres beyond these from which on a place is none of the hair's
# Curls may come farther out, by this share of their radius: nobody sees how each winds.
TURN = 0.5
# No strand stays of which so much is lost, fewer of which less is: long ones are right
# elsewhere.
MOST_LOST = 0.07
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
    seen = abreast(lambda one: comes_out(points, one), sights)
    out = functools.reduce(np.maximum, seen) - TURN * radius
    lost = np.clip(out / LOST, 0.0, 1.0).mean(axis=1)
    stays = np.maximum(1.0 - lost / MOST_LOST, 0.0)
    if radius == 0.0:
        stays[comes_forward(points) < FORWARD] = 0.0
    uv = np.asarray(hair.uv, np.float64)
    count, mean = texel_means(uv, stays)
    share = np.where(count > 0.0, mean, 1.0)
    density = np.asarray(maps.density, np.float64) * np.maximum(share, SPARSEST)
    return eqx.tree_at(
        lambda m: m.density, maps, on_device(density, maps.density.dtype)
    )


def comes_out(
    points: Float[np.ndarray, "strands points 3"], sight: Sight
) -> Float[np.ndarray, "strands points"]:
    """Return how far beyond `FREE` points come out of a photograph's hair, in metres.

    Of what the head hides, or what is beyond the picture, nothing is said.

    Args:
        points: Points of strands, in metres.
        sight: The photograph, and what is behind its hair.
    """
    view, behind = sight
    if not view.hair.any():
        return np.zeros(points.shape[:2])
    pixels = project_points(points.reshape(-1, 3), view.camera)
    y, x, inside = cells(pixels, view.camera.width, view.camera.height)
    if behind is not None:
        inside &= pixels.depth < behind[y, x]
    beside = np.asarray(ndimage.distance_transform_edt(~view.hair))[y, x]
    far = np.maximum(beside - FREE, 0.0) * pixels.depth / view.camera.focal
    return np.where(inside, far, 0.0).reshape(points.shape[:2])


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
