"""Colours of hair, by name or by what pigments it holds."""

from typing import NamedTuple

import jax
import numpy as np

from .chiang import HairFibre, chiang, hair_fibre
from .phase_table import phase_table, scattered_back
from .scene import Colour, HairLook


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
    beta = float(fibre.azimuthal)
    fit = np.polynomial.polynomial.polyval(
        beta, [5.969, -0.215, 2.532, -10.73, 5.574, 0.245]
    )
    red, green, blue = np.exp(-np.sqrt(np.asarray(fibre.absorption)) * fit)
    return float(red), float(green), float(blue)


def plain_look(colour: Colour, **more) -> HairLook:
    """Return hair of a colour with Kajiya's and Kay's highlight."""
    return HairLook(colour=colour, **more)


def chiang_look(pigment: Pigment, *, steps: int = 64, **more) -> HairLook:
    """Return hair as its fibres scatter light: the model of Chiang et al. 2016.

    Light goes on through hair, so that shadows are coloured, and comes back from hair
    around; the latter is taken to be even.

    Args:
        pigment: What the fibres hold.
        steps: Of the table of the scattering function, see `phase_table`.
        more: Other fields of the look.
    """
    fibre = hair_fibre(pigment.eumelanin, pigment.pheomelanin, azimuthal=0.35)
    phase = jax.jit(lambda angles: chiang(angles, fibre))
    table = phase_table(phase, steps, steps)
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
