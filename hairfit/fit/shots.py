"""The photographs that a fit uses, and what it finds in each of them alone."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..abreast import abreast
from ..capture.capture import View
from ..capture.orientation import OrientationMap
from ..capture.scalp_wrap import SeenHead, wrap_scalp
from ..capture.shake import (
    Smear,
    Steady,
    share_of_small,
    smaller_orientation,
    steady_orientation,
)
from ..evaluate.visibility import Sight
from ..model.scalp import Scalp
from ..render.raster import mesh_depth
from ..types import Mesh
from .checkpoint import Checkpoint
from .hull import GAPS, Hull, pixel_sizes, without_gaps
from .suspects import Doubt, find_suspects, shaken_doubt, shrink
from .trust import Trusted, mute_clipped, without_suspects

# Strands are compared with photographs whose pixels are so wide at the hair, in metres:
# few strands stand for many, and hide what is behind a few pixels. Pixels that are
# hardly finer stay as they are.
PIXEL = 0.00056
FINER = 0.75

# Where so many photographs are shaken, and such a share of all, the others probably are
# as well, along their hair: all are looked at in smaller pictures.
SEVERAL, SEVERAL_SHARE = 2, 0.25

Depths = Sequence[Float[np.ndarray, "_height _width"]]


class Shots(NamedTuple):
    """The photographs that are used, and what was found of all of them.

    Attributes:
        views: Those that are used.
        depths: Depth of the head in each of these, in metres.
        used: Which of all photographs they are.
        trusted: All photographs, mended where they had to be.
        doubts: What was wrong with some.
    """

    views: list[View]
    depths: Depths
    used: list[int]
    trusted: Trusted
    doubts: tuple[Doubt, ...]


def trusted_shots(views: Sequence[View], head: Mesh, store: Checkpoint) -> Shots:
    """Return the photographs once doubtful ones are mended or left out."""
    depths = _depths(views, head, store)
    doubts = find_suspects(views, depths, head)
    trusted = without_suspects(views, depths, head, doubts)
    used = [k for k, use in enumerate(trusted.used) if use]
    return Shots(
        [trusted.views[k] for k in used],
        [trusted.depths[k] for k in used],
        used,
        trusted,
        tuple(doubts),
    )


def largest(views: Sequence[View]) -> tuple[int, int]:
    """Return height and width of the smallest picture that would hold all."""
    cameras = [view.camera for view in views]
    return max(c.height for c in cameras), max(c.width for c in cameras)


def coarser_sights(shots: Shots, hull: Hull) -> list[Sight]:
    """Return the photographs that are used, those with fine pixels reduced.

    Args:
        shots: The photographs.
        hull: Where hair can be.
    """
    sights = []
    pixels = pixel_sizes(hull, shots.views)
    for view, depth, pixel in zip(shots.views, shots.depths, pixels, strict=True):
        if pixel < FINER * PIXEL:
            side = round(max(view.hair.shape) * pixel / PIXEL)
            view, depth = shrink(view, depth, side)
        sights.append(Sight(view, depth))
    return sights


def resampled(
    maps: Sequence[OrientationMap], sights: Sequence[Sight]
) -> list[OrientationMap]:
    """Return orientation maps as large as the photographs of `coarser_sights`.

    Every pixel is one of before.
    """
    import cv2

    def at_size(found: OrientationMap, size: tuple[int, int]) -> OrientationMap:
        angle, confidence, sigma = (
            cv2.resize(one, size, interpolation=cv2.INTER_NEAREST)
            for one in (found.angle, found.confidence, found.sigma)
        )
        return OrientationMap(angle, confidence, sigma)

    return [
        found if found.angle.shape == hair.shape else at_size(found, hair.shape[::-1])
        for found, hair in zip(maps, (one.view.hair for one in sights), strict=True)
    ]


def look_at(
    shots: Shots, store: Checkpoint, progress: Callable[[float], None]
) -> tuple[Shots, list[OrientationMap]]:
    """Return the orientation map of every photograph, and what is wrong with more.

    Args:
        shots: The photographs.
        store: Where maps are kept, and taken from.
        progress: Called with the share of them that is done.
    """

    def found_in(view: View) -> Steady:
        saved = store.load(f"orientation-{view.name}")
        if saved is None:
            found, smear = steady_orientation(view.image, view.hair)
            saved = {
                name: np.asarray(getattr(found, name), np.float32)
                for name in ("angle", "confidence", "sigma")
            }
            saved["smear"] = np.array(smear or ())
            store.save(f"orientation-{view.name}", saved)
        smear = saved.pop("smear", ())
        return Steady(OrientationMap(**saved), Smear(*smear) if len(smear) else None)

    def as_shaken(view: View, seen: Steady) -> OrientationMap:
        if seen.smear is not None:
            return seen.found
        return smaller_orientation(view.image, view.hair, share_of_small(view.hair))

    views, seen = shots.trusted.views, []
    for one in abreast(found_in, views):
        seen.append(one)
        progress(len(seen) / len(views))
    doubts = [
        shaken_doubt(view.name, one.smear)
        for view, one in zip(views, seen, strict=True)
        if one.smear is not None
    ]
    maps = [one.found for one in seen]
    if len(doubts) >= max(SEVERAL, SEVERAL_SHARE * len(views)):
        maps = list(abreast(as_shaken, views, seen))
    doubts = [*shots.doubts, *doubts]
    maps = mute_clipped(views, maps, doubts)
    return shots._replace(doubts=tuple(doubts)), maps


def wrapped_scalp(shots: Shots, head: Mesh, gaps: float = GAPS) -> Scalp:
    """Return the scalp that the photographs' masks draw on a head.

    Skin shows between shorn hairs, which grow there all the same.

    Args:
        shots: The photographs.
        head: The head.
        gaps: Radius of the widest gaps between hairs, in metres.
    """
    both = zip(shots.views, shots.depths, strict=True)
    closed = [SeenHead(without_gaps(*one, gaps), one[1]) for one in both]
    return wrap_scalp(head, closed)


def _depths(views: Sequence[View], head: Mesh, store: Checkpoint) -> Depths:
    saved = store.load("depth")
    if saved is None:
        found = abreast(lambda view: mesh_depth(head, view.camera), views)
        saved = {view.name: depth for view, depth in zip(views, found, strict=True)}
        store.save("depth", saved)
    return [saved[view.name] for view in views]
