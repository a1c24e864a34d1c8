"""The head beside the hair: a matt surface in the same light.

How light falls on a matt surface says from where it comes, and how bright it is, better
than hair does, whose highlights and shadows depend on each strand.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import ndimage

from ..evaluate.visibility import Sight
from ..render.lit import from_sky, turned_to
from ..render.raster import cells, project_points, vertex_normals
from ..render.scene import OUTSIDE, head_places
from ..types import Mesh

PIXELS = 500  # of each photograph, of hair and of the head
CLIPPED = 0.95  # linear: what is brighter may be any brighter
BESIDE_HAIR = 4  # pixels beside hair that may still be hair
INSIDE = 2  # pixels from the head's outline, which may show what is behind it


class Bare(NamedTuple):
    """Pixels of the head in all photographs, and what light would do there.

    Attributes:
        seen: What the photographs show, linear RGB.
        view: The photograph of each pixel.
        shade: What a white matt head sends back of each light, shadowed.
        sky: What it sends back of light from all sides.
    """

    seen: Float[np.ndarray, "pixels 3"]
    view: Int[np.ndarray, " pixels"]
    shade: Float[np.ndarray, "pixels lights"]
    sky: Float[np.ndarray, " pixels"]


def bare_pixels(
    head: Mesh | None,
    sights: Sequence[Sight],
    ways: Float[np.ndarray, "lights 3"],
    share: Float[np.ndarray, "places lights"],
    rng: np.random.Generator,
) -> Bare:
    """Return some pixels of each photograph that show the head and no hair.

    Args:
        head: The head; no pixels are found if it is None.
        sights: The photographs, and the depth of the head in them.
        ways: Unit vectors towards the lights.
        share: How much of each light arrives at `head_places`.
        rng: Chooses among the pixels.
    """
    none = np.zeros((0, 3)), np.zeros(0, int), np.zeros((0, len(ways))), np.zeros(0)
    parts = [Bare(*none)]
    if head is None:
        return parts[0]
    places, normals = head_places(head), vertex_normals(head)
    for k, (photo, behind) in enumerate(sights):
        if behind is None:
            continue
        pixels = project_points(places, photo.camera)
        y, x, inside = cells(pixels, photo.camera.width, photo.camera.height)
        # Skin that shows through hair is darker than what is beside it.
        wide = ndimage.binary_dilation(photo.hair, iterations=BESIDE_HAIR)
        hair = np.asarray(ndimage.binary_fill_holes(wide), bool)
        inner = ndimage.binary_erosion(np.isfinite(behind), iterations=INSIDE)
        free = (
            inside
            & ~hair[y, x]
            & np.asarray(inner, bool)[y, x]
            & (pixels.depth < behind[y, x] + OUTSIDE)
            & (photo.image[y, x].max(axis=-1) < CLIPPED)
        )
        at = np.flatnonzero(free)
        at = rng.choice(at, min(PIXELS, len(at)), replace=False)
        normal = turned_to(np.asarray(photo.camera.centre), normals[at], places[at])
        parts.append(
            Bare(
                photo.image[y[at], x[at]],
                np.full(len(at), k),
                share[at] * np.maximum(normal @ ways.T, 0.0),
                from_sky(normal),
            )
        )
    return Bare(*map(np.concatenate, zip(*parts, strict=True)))
