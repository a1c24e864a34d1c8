"""Colours of hair: by name, by what pigments it holds, or as an artist picks them."""

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .chiang import HairFibre, chiang, hair_fibre
from .phase import PhaseAngles
from .phase_table import phase_table, scattered_back
from .scene import Colour, HairLook

Scattering = Callable[[PhaseAngles, HairFibre], Float[Array, " 3"]]
# What hair of these names looks like, linear RGB. Melanin alone makes no ginger and no
# grey hair, and in pictures the blonde above is brown and the brown black.
SHADES: dict[str, Colour] = {
    "black": (0.018, 0.015, 0.013),
    "brown": (0.24, 0.110, 0.048),
    "blonde": (0.52, 0.34, 0.15),
    "red": (0.34, 0.085, 0.026),
    "grey": (0.30, 0.29, 0.28),
    "white": (0.68, 0.67, 0.64),
}
# A fibre's colour beside it: in light from several sides hair is brighter than a matt
# surface of its colour.
OF_FIBRE = 0.4
# Of the azimuthal lobes of hair in pictures.
AZIMUTHAL = 0.35
# An artist's black and white: no pigment makes hair that sends back nothing.
DARKEST, BRIGHTEST = 0.002, 0.999


class Pigment(NamedTuple):
    """How much of both melanins hair holds.

    Attributes:
        eumelanin: Concentration of the brown pigment.
        pheomelanin: Concentration of the red one.
    """

    eumelanin: float
    pheomelanin: float


# As in the photographs that hairfit is measured with.
PIGMENTS = {
    "black": Pigment(4.0, 0.3),
    "brown": Pigment(1.6, 0.35),
    "blonde": Pigment(0.25, 0.35),
    "red": Pigment(0.5, 1.2),
    "grey": Pigment(0.08, 0.02),
    "white": Pigment(0.0, 0.0),
}


def colour_of(fibre: HairFibre) -> Colour:
    r"""Return the colour of much hair, light having been scattered many times.

    $\ln C = -\sqrt{\sigma_a}\,p(\beta_N)$, the inverse of the fit by which artists'
    colours become absorption [Chiang et al. 2016, equation (9)].

    Args:
        fibre: One fibre.
    """
    root = np.sqrt(np.asarray(fibre.absorption, np.float64))
    red, green, blue = np.exp(-root * darkening(float(fibre.azimuthal)))
    return float(red), float(green), float(blue)


def fibre_of_colour(colour: Colour, azimuthal: float = AZIMUTHAL) -> HairFibre:
    r"""Return a fibre of which much hair has a colour, the inverse of `colour_of`.

    $\sigma_a = (\ln C / p(\beta_N))^2$ [Chiang et al. 2016, equation (9)].

    Args:
        colour: The colour, linear RGB.
        azimuthal: Azimuthal roughness of the fibre.
    """
    shade = np.clip(np.asarray(colour, np.float64), DARKEST, BRIGHTEST)
    absorption = (np.log(shade) / darkening(azimuthal)) ** 2
    fibre = hair_fibre(azimuthal=azimuthal)
    return eqx.tree_at(lambda f: f.absorption, fibre, jnp.asarray(absorption))


def fibre_of_pigment(pigment: Pigment, azimuthal: float = AZIMUTHAL) -> HairFibre:
    """Return a fibre that holds so much of both melanins."""
    return hair_fibre(*pigment, azimuthal=azimuthal)


def fibre_of_name(name: str) -> HairFibre:
    """Return a fibre of hair of one of the names in `SHADES`."""
    red, green, blue = SHADES[name]
    return fibre_of_colour((OF_FIBRE * red, OF_FIBRE * green, OF_FIBRE * blue))


def darkening(beta: float) -> float:
    r"""Return $p(\beta_N)$ of equation (9): how much absorption darkens much hair."""
    fit = np.polynomial.polynomial.polyval(
        beta, [5.969, -0.215, 2.532, -10.73, 5.574, 0.245]
    )
    return float(fit)


def chiang_look(pigment: Pigment, *, steps: int = 64, **more) -> HairLook:
    """Return hair as its fibres scatter light by the model of Chiang et al. 2016."""
    return fibre_look(fibre_of_pigment(pigment), chiang, steps=steps, **more)


def fibre_look(
    fibre: HairFibre, model: Scattering = chiang, *, steps: int = 64, **more
) -> HairLook:
    """Return hair as its fibres scatter light.

    Light goes on through hair, so that shadows are coloured, and comes back from hair
    around; the latter is taken to be even.

    Args:
        fibre: One fibre.
        model: Its scattering function: `chiang`, or `marschner`.
        steps: Of the table of the scattering function, see `phase_table`.
        more: Other fields of the look.
    """
    table = phase_table(jax.jit(lambda angles: model(angles, fibre)), steps, steps)
    back = scattered_back(table)
    red, green, blue = (float(x) for x in np.minimum(table.forward, 0.95))
    return HairLook(
        colour=(float(back[0]), float(back[1]), float(back[2])),
        diffuse=1.0,
        ambient=1.0,
        forward=(red, green, blue),
        table=table,
        **more,
    )
