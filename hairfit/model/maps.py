"""Maps painted on the scalp: density, length, thickness, colour and curl."""

import equinox as eqx
from jaxtyping import Array, Float


class ScalpMaps(eqx.Module):
    """What is painted on the scalp [Kim02, section 4.9, figure 7-5].

    Texels are the corners of an even grid: `[i, j]` stands at `u = i / (rows - 1)`,
    `v = j / (columns - 1)`; between them values are bilinear.

    Attributes:
        density: Share of the roots that grow, 0 (bald) to 1.
        length: Share of the length that hair grows to, 0 to 1.
        thickness: Diameter of a hair at its root, in metres.
        colour: Linear RGB.
        curl: Radius of the curls of single hairs, in metres; 0 is straight.
    """

    density: Float[Array, "rows columns"]
    length: Float[Array, "rows columns"]
    thickness: Float[Array, "rows columns"]
    colour: Float[Array, "rows columns 3"]
    curl: Float[Array, "rows columns"]
