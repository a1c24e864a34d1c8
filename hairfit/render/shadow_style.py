"""How opacity shadow maps are made, for every engine [Kim02, section 6.2]."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Float

from .slices import density_slices, gamma_slices, uniform_slices

Scheme = Literal["uniform", "density", "gamma", "adaptive"]
Filter = Literal["bilinear", "box3"]
Interpolation = Literal["linear", "cubic"]


@dataclasses.dataclass(frozen=True)
class ShadowStyle:
    r"""Resolution and filters of opacity shadow maps.

    Attributes:
        size: Width and height of a map, in texels.
        slices: Number of maps; of layers a texel, if they are adaptive.
        scheme: Where maps lie (figure 6-4); `adaptive` puts them in each texel where
            it has hair, see `opacity_occupied`.
        filter: Weights of texels around a point; `box3` is the thesis's 3 x 3 average.
        interpolation: Between maps: linear (6-2), or a monotone cubic.
        kappa: Scale of the opacity, $\kappa$ of table 6-1. At 1, hair of its true width
            lets no light through itself.
        bias: How far behind a head's surface a point is still lit, in metres.

    Raises:
        ValueError: If there is no map, or maps without texels.
    """

    size: int = 512
    slices: int = 64
    scheme: Scheme = "uniform"
    filter: Filter = "bilinear"
    interpolation: Interpolation = "linear"
    kappa: float = 1.0
    bias: float = 0.003

    def __post_init__(self):
        if self.size < 8 or self.slices < 1 or not self.kappa >= 0.0:
            raise ValueError(
                f"shadow maps need at least 8 texels a side, 1 slice and a kappa of 0 "
                f"or more, got {self.size}, {self.slices} and {self.kappa}."
            )

    def depths(self, depth: Float[np.ndarray, " points"]) -> Float[np.ndarray, " n"]:
        """Return the depths of the maps for hair at these depths from the light."""
        nearest, farthest = float(depth.min()), float(depth.max())
        farthest = max(farthest, nearest + 1e-4)
        if self.scheme == "density":
            return density_slices(np.append(depth, farthest), self.slices)
        if self.scheme == "gamma":
            return gamma_slices(nearest, farthest, self.slices)
        return uniform_slices(nearest, farthest, self.slices)


# Good enough for a picture of a few hundred pixels. Few even maps would show as bands
# on hair that hangs along the light.
PREVIEW_SHADOWS = ShadowStyle(size=256, slices=16, scheme="adaptive")
