r"""From light to what the eye sees: tone and colour [Kim02, section 5.8]."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, ScalarLike

# OKLab [Ottosson 2020, A perceptual color space for image processing]: linear sRGB to
# responses of the cones, and their cube roots to lightness and two opponent colours.
CONES = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
OPPONENTS = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
# Light below this has no colour that the eye could tell.
DARKEST = 1e-9


def oklab(rgb: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Return lightness and the two opponent colours of a linear sRGB colour.

    Args:
        rgb: The colour, none of it negative.
    """
    cones = jnp.asarray(CONES, rgb.dtype) @ rgb
    return jnp.asarray(OPPONENTS, rgb.dtype) @ jnp.cbrt(jnp.maximum(cones, DARKEST))


def from_oklab(lab: Float[Array, " 3"]) -> Float[Array, " 3"]:
    """Return the linear sRGB colour of OKLab; some may be negative out of the gamut."""
    roots = jnp.asarray(np.linalg.inv(OPPONENTS), lab.dtype) @ lab
    return jnp.asarray(np.linalg.inv(CONES), lab.dtype) @ roots**3


def attenuate(
    rgb: Float[Array, " 3"], share: ScalarLike, keep: float | Float[Array, ""] = 0.5
) -> Float[Array, " 3"]:
    r"""Return a colour in shadow: as bright as light demands, but no less of a colour.

    Section 5.8 warns that a scaled RGB colour has not the same tone any more: a scaled
    yellow does not feel like blond hair. It keeps its hue, but its chroma falls with
    its lightness, and it looks grey. Here lightness falls as it does for scaled light,
    and chroma in OKLab by less: by the cube root of `share` to the power `1 - keep`.

    Args:
        rgb: The colour in full light, linear sRGB.
        share: Of the light that is left, from 0 to 1.
        keep: How much of the chroma is kept: 0 scales RGB, 1 keeps all of it.
    """
    scaled = rgb * share
    light, *opponents = oklab(scaled)
    root = jnp.cbrt(jnp.maximum(jnp.asarray(share, rgb.dtype), DARKEST))
    richer = from_oklab(jnp.stack([light, *(x * root**-keep for x in opponents)]))
    return inside_gamut(richer, scaled)


def inside_gamut(
    rgb: Float[Array, " 3"], safe: Float[Array, " 3"]
) -> Float[Array, " 3"]:
    """Return a colour moved towards a safe one until nothing of it is negative.

    Args:
        rgb: The colour, linear.
        safe: A colour with no negative part.
    """
    short = jnp.where(rgb < 0.0, safe / jnp.maximum(safe - rgb, DARKEST), 1.0)
    return safe + jnp.min(short) * (rgb - safe)


def tone(
    rgb: Float[Array, "*pixels 3"], white: ScalarLike = 4.0
) -> Float[Array, "..."]:
    r"""Return light brought into [0, 1] by a curve that spares the dark.

    Reinhard's extended operator [Reinhard et al. 2002, equation (4)] on luminance,
    $L (1 + L / w^2) / (1 + L)$; colours keep their ratios.

    Args:
        rgb: Linear light.
        white: The luminance that becomes white.
    """
    weights = jnp.asarray([0.2126, 0.7152, 0.0722], rgb.dtype)
    luminance = jnp.matmul(rgb, weights, precision="highest")[..., None]
    return rgb * (1.0 + luminance / white**2) / (1.0 + luminance)
