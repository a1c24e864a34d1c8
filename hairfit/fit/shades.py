"""How dark hair is in photographs, highlights aside: alike wherever one looks from.

Between locks and under others hair is dark for all who see it. A highlight is where
light, hair and view meet, and goes along with the view. So all that is brighter than
half of the hair counts as bright as that.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32

from ..abreast import abreast
from ..capture.capture import View
from ..capture.filters import mean_of_hair
from .evidence import Planes
from .hull import Hull, pixel_sizes

LIT = 0.5  # share of the hair that is darker than what may be a highlight
DARKEST = 0.02  # share of a photograph's hair that counts as no darker: all noise
BLUR = 0.0015  # metres: standard deviation of the Gaussian of a place
AROUND = 0.006  # metres: of what is about it
PLAIN = 0.1  # of the variance over all hair, for places about which hair is alike
LEAST = 1e-3  # variance of logarithms below which nothing is seen
ROUNDS = 4  # in which places that differ much come to count less
ALIKE = 0.1  # difference of logarithms up to which all count the same


class Shade(NamedTuple):
    """How dark the hair in a photograph is.

    Attributes:
        level: Logarithm of its brightness, without highlights.
        contrast: Variance of that about each pixel.
    """

    level: Float32[np.ndarray, "height width"]
    contrast: Float32[np.ndarray, "height width"]


def find_shades(
    hull: Hull, views: Sequence[View], looks: Sequence[Planes]
) -> list[Shade]:
    """Return how dark hair is in each photograph, as if all were exposed alike.

    Args:
        hull: The hull.
        views: The photographs.
        looks: What each sees of places that many see: they tell the exposures.
    """
    blurs = [BLUR / pixel for pixel in pixel_sizes(hull, views)]
    light = [light_of(view) for view in views]
    means = abreast(mean_of_hair, light, [view.hair for view in views], blurs)
    levels = [mean[look.at] for mean, look in zip(means, looks, strict=True)]
    exposure = exposures(np.stack(levels), np.stack([look.seen for look in looks]))
    light = [one - np.float32(e) for one, e in zip(light, exposure, strict=True)]
    lit = np.float32(np.quantile(of_hair(light, views), LIT))

    def shade_of(one, view, blur):
        level = mean_of_hair(np.minimum(one, lit), view.hair, blur)
        mean, square = (
            mean_of_hair(moment, view.hair, blur * AROUND / BLUR)
            for moment in (level, level**2)
        )
        return Shade(level, np.maximum(square - mean**2, 0.0))

    shades = list(abreast(shade_of, light, views, blurs))
    levels = of_hair([shade.level for shade in shades], views)
    plain = np.maximum(PLAIN * np.var(levels), LEAST)
    return [shade._replace(contrast=shade.contrast + plain) for shade in shades]


def light_of(view: View) -> Float32[np.ndarray, "height width"]:
    """Return the logarithm of a photograph's brightness."""
    grey = view.image.mean(axis=2)
    darkest = float(np.quantile(grey[view.hair], DARKEST)) if view.hair.any() else 1.0
    return np.log(np.maximum(grey, max(darkest, 1e-6))).astype(np.float32)


def of_hair(
    maps: Sequence[Float32[np.ndarray, "_height _width"]], views: Sequence[View]
) -> Float32[np.ndarray, " pixels"]:
    """Return what maps of photographs say in all their pixels of hair."""
    return np.concatenate(
        [one[view.hair] for one, view in zip(maps, views, strict=True)]
    )


def exposures(
    levels: Float[np.ndarray, "views places"], seen: Float[np.ndarray, "views places"]
) -> Float[np.ndarray, " views"]:
    """Return how much brighter each photograph is than all, as a logarithm.

    Least squares of what photographs say of the same places, whatever that is; places
    at which they differ by more than `ALIKE` count by its share of the difference.

    Args:
        levels: Logarithm of the brightness of each place.
        seen: How well each place is seen.
    """
    found, weight = np.zeros(len(levels)), seen
    for _ in range(ROUNDS):
        total = np.maximum(weight.sum(axis=0), 1e-9)
        apart = levels - (weight * levels).sum(axis=0) / total
        system = np.diag(weight.sum(axis=1)) - (weight / total) @ weight.T
        right = (weight * apart).sum(axis=1)
        found = np.linalg.lstsq(system, right, rcond=1e-6)[0]
        left = levels - found[:, None]
        off = left - (weight * left).sum(axis=0) / total
        weight = seen / np.maximum(np.abs(off), ALIKE)
    return found - found.mean()
