"""How much of a photograph's mask recovered hair covers, once its hairs have a width.

A mask is where hair hides at least half of a pixel. Recovered hair is fewer strands
than real hair, and single hairs leave every hairstyle: to count a pixel as covered
wherever one strand passes makes any hairstyle too wide, the true one as well. So each
strand stands for as wide a ribbon as makes all of them cover the photographs best.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..abreast import abreast
from ..capture.capture import View
from ..capture.filters import square_means
from ..render.camera import Camera, resized
from ..render.raster import picture_segments, project_points
from .visibility import Sight

STEP_PX = 0.7
"""Greatest distance between two samples of a segment."""

AT_ONCE = 1 << 20
"""Samples that are held at once, about."""

WIDTHS = np.geomspace(1e-6, 1e-2, 121)
"""Widths that are tried, in metres."""

AS_WELL = 0.01
"""By so much of IoU may hair cover less than the best and count as covering as well."""

TALL = 320
"""Height to which pictures are made smaller where the width of few strands is asked."""


class Coverage(NamedTuple):
    """How hair of one width covers photographs.

    Attributes:
        width: Width of a strand, in metres.
        iou: For each photograph, the area that covered pixels and the hair's mask have
            in common, over that of either.
    """

    width: float
    iou: tuple[float, ...]


def fit_width(
    points: Float[np.ndarray, "strands knots 3"], sights: Sequence[Sight]
) -> Coverage:
    """Return the width at which strands cover the hair's masks best, on the mean.

    Args:
        points: The strands, with equal counts of points, in metres.
        sights: The photographs, one or more.
    """
    return best_width(list(abreast(lambda one: overlaps(points, one, WIDTHS), sights)))


def best_width(each: Sequence[Float[np.ndarray, " widths"]]) -> Coverage:
    """Return the width at which the mean over photographs is greatest.

    Args:
        each: For each photograph the IoU at each of `WIDTHS`.
    """
    ious = np.stack(each)
    best = int(ious.mean(axis=0).argmax())
    return Coverage(float(WIDTHS[best]), tuple(ious[:, best].tolist()))


def narrowest_width(
    points: Float[np.ndarray, "strands knots 3"], sights: Sequence[Sight]
) -> float:
    """Return the least width at which strands cover the masks as well as at the best.

    The best itself may be far wider where strands lie within the masks: the more they
    hide there, the less it changes. Pictures are made smaller first, as in fine pixels
    few strands leave gaps that no width fills.

    Args:
        points: The strands, with equal counts of points, in metres.
        sights: The photographs, one or more.
    """
    each = abreast(lambda one: overlaps(points, coarser(one), WIDTHS), sights)
    return narrowest(list(each))


def narrowest(each: Sequence[Float[np.ndarray, " widths"]]) -> float:
    """Return the least width at which the mean over photographs is as at the best.

    Args:
        each: For each photograph the IoU at each of `WIDTHS`.
    """
    iou = np.mean(each, axis=0)
    return float(WIDTHS[int(np.argmax(iou >= iou.max() - AS_WELL))])


def coarser(sight: Sight) -> Sight:
    """Return the hair's mask of a photograph, and what hides hair, `TALL` pixels high.

    As many pixels a side are one as make it that high at most; it is hair if half of
    them are.
    """
    view, behind = sight
    times = -(-view.camera.height // TALL)
    width, height = view.camera.width // times, view.camera.height // times
    # Of pixels at the border that fill no block, nothing is asked.
    whole = slice(height * times), slice(width * times)
    share = square_means(view.hair[whole][..., None].astype(np.float32), times)
    image = view.image[whole][times // 2 :: times, times // 2 :: times]
    camera = dataclasses.replace(
        view.camera, width=width * times, height=height * times
    )
    small = View(
        view.name,
        resized(camera, width, height),
        image,
        share[..., 0] >= 0.5,
    )
    if behind is not None:
        behind = behind[whole][times // 2 :: times, times // 2 :: times]
    return Sight(small, behind)


def overlaps(
    points: Float[np.ndarray, "strands knots 3"],
    sight: Sight,
    widths: Float[np.ndarray, " widths"],
) -> Float[np.ndarray, " widths"]:
    r"""Return the IoU of covered pixels and the hair's mask for strands of some widths.

    Strands of width $w$ that lie at random hide the share $1 - \exp(-w L)$ of a pixel
    through which the length $L$ runs, in pixels a metre of width: half of it, where
    $w L = \ln 2$.

    Args:
        points: The strands, with equal counts of points, in metres.
        sight: The photograph.
        widths: The widths, in metres.
    """
    view, behind = sight
    return ious_of(hair_density(points, view.camera, behind), view.hair, widths)


def ious_of(
    drawn: Float[np.ndarray, "*pixels"],
    wanted: Bool[np.ndarray, "*pixels"],
    widths: Float[np.ndarray, " widths"],
) -> Float[np.ndarray, " widths"]:
    """Return the IoU of pixels that are hidden by half and those that are hair.

    Args:
        drawn: How much of each pixel strands would hide per metre of their width.
        wanted: Which pixels are hair.
        widths: The widths of strands, in metres.
    """
    least = np.log(2.0) / np.asarray(widths, np.float64)
    inside, beside = np.sort(drawn[wanted]), np.sort(drawn[~wanted])
    both = len(inside) - np.searchsorted(inside, least)
    either = len(inside) + len(beside) - np.searchsorted(beside, least)
    # As `photographs.overlap` has it: 1 if both are empty.
    return np.where(either > 0, both / np.maximum(either, 1), 1.0)


def hair_density(
    points: Float[np.ndarray, "strands knots 3"],
    camera: Camera,
    mesh_depth: Float[np.ndarray, "height width"] | None = None,
) -> Float[np.ndarray, "height width"]:
    """Return how much of each pixel strands would hide per metre of their width.

    Args:
        points: The strands, with equal counts of points, in metres.
        camera: The camera.
        mesh_depth: Depth of what hides hair, infinite where nothing does.
    """
    width, height = camera.width, camera.height
    total = np.zeros(width * height)
    for _, y, x, hides in drawn_pieces(points, camera, mesh_depth):
        total += np.bincount(y * width + x, hides, minlength=width * height)
    return total.reshape(height, width)


class Pieces(NamedTuple):
    """Short pieces of strands in a picture.

    Attributes:
        strand: The strand of each.
        y, x: The pixel in which it lies.
        hides: How much of that pixel it hides, per metre of the strand's width.
    """

    strand: Int[np.ndarray, " pieces"]
    y: Int[np.ndarray, " pieces"]
    x: Int[np.ndarray, " pieces"]
    hides: Float[np.ndarray, " pieces"]


def drawn_pieces(
    points: Float[np.ndarray, "strands knots 3"],
    camera: Camera,
    mesh_depth: Float[np.ndarray, "height width"] | None = None,
) -> Iterator[Pieces]:
    """Yield pieces of strands shorter than a pixel, some million at a time.

    Those behind the mesh hide nothing, and are among them.

    Args:
        points: The strands, with equal counts of points, in metres.
        camera: The camera.
        mesh_depth: Depth of what hides hair, infinite where nothing does.
    """
    width, height = camera.width, camera.height
    segments = picture_segments(project_points(points, camera), width, height)
    strand = segments.number // max(points.shape[1] - 1, 1)
    length = np.linalg.norm(segments.step, axis=1)
    count = np.maximum(np.ceil(length / STEP_PX), 1.0).astype(np.int64)
    piece = length / count
    # Parts of about as many samples: large photographs hold many.
    cuts = np.searchsorted(np.cumsum(count), np.arange(AT_ONCE, count.sum(), AT_ONCE))
    for part in np.split(np.arange(len(count)), cuts):
        owner = np.repeat(part, count[part])
        first = np.cumsum(count[part]) - count[part]
        number = np.arange(len(owner)) - np.repeat(first, count[part])
        share = (number + 0.5) / count[owner]
        place = segments.start[owner] + share[:, None] * segments.step[owner]
        x, y = np.minimum(place.astype(int), [width - 1, height - 1]).T
        near = segments.inverse_depth[owner]
        inverse = near[:, 0] + share * near[:, 1]
        hides = piece[owner] * inverse * camera.focal
        if mesh_depth is not None:
            hides = np.where(inverse * mesh_depth[y, x] >= 1.0, hides, 0.0)
        yield Pieces(strand[owner], y, x, hides)
