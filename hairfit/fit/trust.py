"""Photographs as a fit should use them, after what is wrong with some was found."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from ..capture.capture import View
from ..capture.orientation import OrientationMap
from ..render.raster import mesh_depth
from ..types import Mesh
from .agreement import ask_all, find_candidates, hull_without, silhouette
from .suspects import Doubt, clipped, flipped, shrink

LEAST_VIEWS = 3  # no photograph is left out if fewer would stay
CLIPPED_REACH = 3  # pixels around clipped ones whose texture is not the hair's


class Trusted(NamedTuple):
    """Photographs as a fit should use them, in the same order.

    Attributes:
        views: All photographs, mended where they can be.
        depths: Depth of the head in each of them, in metres.
        used: Which of them the fit should use.
    """

    views: tuple[View, ...]
    depths: list[Float[np.ndarray, "_height _width"]]
    used: list[bool]


def without_suspects(
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    head: Mesh,
    doubts: Sequence[Doubt],
) -> Trusted:
    """Return the photographs with what is doubtful mended or left out.

    A mask that is not trusted becomes the outline of what all other photographs allow,
    so that it has no say in carving.

    Args:
        views: The photographs.
        depths: Depth of the head in each of them, in metres.
        head: The head.
        doubts: What was found.
    """
    about = {doubt.view: doubt for doubt in doubts}
    new_views, new_depths = list(views), list(depths)
    used = [True] * len(views)
    for k, view in enumerate(views):
        doubt = about.get(view.name)
        if doubt is None:
            continue
        if doubt.remedy == "flip all":
            new_views[k] = flipped(view)
        elif doubt.remedy == "flip image":
            new_views[k] = dataclasses.replace(view, image=view.image[:, ::-1])
        elif doubt.camera is not None:
            new_views[k] = dataclasses.replace(view, camera=doubt.camera)
            new_depths[k] = mesh_depth(head, doubt.camera)
        elif doubt.remedy == "leave out":
            used[k] = False
    if sum(used) < LEAST_VIEWS:
        used = [True] * len(views)
    # Masks last: the other photographs must be mended before they speak for one.
    masked = [k for k, v in enumerate(views) if remedy_of(about, v) == "open mask"]
    for k in masked:
        carving = [j for j in range(len(views)) if used[j] and j not in masked]
        hair = opened_mask(new_views, new_depths, head, k, carving)
        new_views[k] = dataclasses.replace(new_views[k], hair=hair)
    return Trusted(tuple(new_views), new_depths, used)


def remedy_of(about: dict[str, Doubt], view: View) -> str | None:
    """Return what should be done with a photograph, None if nothing."""
    doubt = about.get(view.name)
    return None if doubt is None else doubt.remedy


def opened_mask(
    views: Sequence[View],
    depths: Sequence[Float[np.ndarray, "_height _width"]],
    head: Mesh,
    k: int,
    carving: Sequence[int],
) -> Bool[np.ndarray, "height width"]:
    """Return where photograph `k` may show hair, as the carving ones allow it.

    What is known to be the rest of the person is left out; where nothing is left, the
    mask stays as it is.
    """
    import cv2

    chosen = [*carving, k]
    shots = [shrink(views[j], depths[j]) for j in chosen]
    small, near = zip(*shots, strict=True)
    points = find_candidates(small[:-1], near[:-1], head, 0)
    sights = ask_all(points, small, near)
    hull = hull_without(sights, small, (len(chosen) - 1,))
    drawn = silhouette(hull, sights[-1], small[-1].hair.shape)
    drawn = ndimage.binary_dilation(drawn)
    view = views[k]
    size = (view.camera.width, view.camera.height)
    hair = cv2.resize(drawn.astype(np.float32), size) > 0.5
    if view.body is not None:
        hair &= ~view.body
    return hair if hair.any() else view.hair


def mute_clipped(
    views: Sequence[View], maps: Sequence[OrientationMap], doubts: Sequence[Doubt]
) -> list[OrientationMap]:
    """Return orientation maps that say nothing where a picture is clipped or black.

    Args:
        views: The photographs.
        maps: Their orientation maps.
        doubts: What was found; only photographs of doubtful exposure change.
    """
    dazzled = {doubt.view for doubt in doubts if doubt.remedy == "mute clipped"}
    out = []
    for view, found in zip(views, maps, strict=True):
        if view.name in dazzled:
            lost = ndimage.maximum_filter(clipped(view), size=2 * CLIPPED_REACH + 1)
            sure = np.where(lost, 0.0, found.confidence).astype(found.confidence.dtype)
            found = dataclasses.replace(found, confidence=sure)
        out.append(found)
    return out
