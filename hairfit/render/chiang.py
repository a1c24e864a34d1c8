r"""Light in a hair fibre, by Chiang et al. 2016, near field and far field.

Chiang, Bitterli, Tappan, Burley: A practical and controllable hair and fur model for
production path tracing; with the lobes of d'Eon et al. 2011, as Pharr's "The
implementation of a hair scattering model" (2016) writes them down and Mitsuba 3's
`hair` has them.
"""

import math
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import i0e
from jaxtyping import Array, Float

from .dielectric import fresnel
from .phase import PhaseAngles, wrapped

# Paths with up to so many segments inside have a lobe of their own: R, TT and TRT. The
# rest is one lobe that is even in azimuth.
PATHS = 3
# Absorption of the two melanins at a concentration of 1, in linear RGB, in units of
# 1 / the fibre's radius [d'Eon et al. 2011].
EUMELANIN = (0.419, 0.697, 1.37)
PHEOMELANIN = (0.187, 0.4, 1.05)
# Offsets of the ray across the fibre at which the far field is measured.
OFFSETS = 32


class HairFibre(eqx.Module):
    """What a fibre is made of.

    Attributes:
        absorption: Absorption inside, in linear RGB, per radius of the fibre.
        roughness: Longitudinal roughness, above 0, up to 1.
        azimuthal: Azimuthal roughness, above 0, up to 1.
        tilt: Angle of the cuticle's scales, in radians; they point to the tip.
        ior: Index of refraction.
    """

    absorption: Float[Array, " 3"]
    roughness: Float[Array, ""]
    azimuthal: Float[Array, ""]
    tilt: Float[Array, ""]
    ior: Float[Array, ""]


def hair_fibre(
    eumelanin: float = 1.3,
    pheomelanin: float = 0.2,
    roughness: float = 0.3,
    azimuthal: float = 0.3,
    tilt_deg: float = 2.0,
    ior: float = 1.55,
) -> HairFibre:
    """Return a fibre by its pigments; what is left out is brown hair.

    Args:
        eumelanin: Concentration of the brown pigment: 0.3 is blond, 1.3 brown, 8 black.
        pheomelanin: Concentration of the red pigment.
        roughness: Longitudinal roughness.
        azimuthal: Azimuthal roughness.
        tilt_deg: Angle of the cuticle's scales, in degrees.
        ior: Index of refraction.

    Raises:
        ValueError: If a concentration is negative, a roughness is not in (0, 1] or the
            index is not above 1.
    """
    if min(eumelanin, pheomelanin) < 0.0 or ior <= 1.0:
        raise ValueError(
            f"a fibre needs concentrations of at least 0 and an index above 1, got "
            f"{eumelanin}, {pheomelanin} and {ior}."
        )
    if not (0.0 < roughness <= 1.0 and 0.0 < azimuthal <= 1.0):
        raise ValueError(
            f"roughness must be above 0 and at most 1, got {roughness} and {azimuthal}."
        )
    pigments = np.array([EUMELANIN, PHEOMELANIN])
    numbers = roughness, azimuthal, math.radians(tilt_deg), ior
    return HairFibre(
        jnp.asarray(np.array([eumelanin, pheomelanin]) @ pigments),
        *(jnp.asarray(float(x)) for x in numbers),
    )


class Inside(NamedTuple):
    r"""A ray across a fibre.

    Attributes:
        entry: Angle of incidence across the fibre, $\gamma_o$.
        refracted: The same inside, $\gamma_t$.
        shares: $A_p$ of each path and of the rest: its share of the light, in RGB.
    """

    entry: Float[Array, ""]
    refracted: Float[Array, ""]
    shares: Float[Array, "4 3"]


def chiang_near(
    angles: PhaseAngles, fibre: HairFibre, offset: Float[Array, ""]
) -> Float[Array, " 3"]:
    r"""Return the scattering function of a ray that is seen beside a fibre's middle.

    $f = \sum_p M_p A_p N_p / \cos\theta$, so that light from all directions, weighted
    by $\cos\theta$, comes back wholly from a fibre that absorbs nothing.

    Args:
        angles: Inclinations and azimuth; they count towards the hair's tip.
        fibre: What the fibre is made of.
        offset: Where across the fibre it is seen, from -1 to 1.
    """
    theta_eye, theta = angles.theta_eye, angles.theta
    ray = inside(theta_eye, fibre, offset)
    width = longitudinal_width(fibre.roughness)
    spread = logistic_scale(fibre.azimuthal)
    total = jnp.zeros(3, ray.shares.dtype)
    # R leaves by twice the tilt, TT and TRT as the ray meets scales from behind.
    for path, turn in enumerate((-2.0, 1.0, 4.0)):
        tilted = theta_eye + turn * fibre.tilt
        along = longitudinal(theta, tilted, (1.0, 0.25, 4.0)[path] * width)
        straight = 2.0 * path * ray.refracted - 2.0 * ray.entry + path * jnp.pi
        around = trimmed_logistic(wrapped(angles.phi - straight), spread)
        total = total + along * around * ray.shares[path]
    rest = longitudinal(theta, theta_eye, 4.0 * width) / (2.0 * jnp.pi)
    return (total + rest * ray.shares[PATHS]) / jnp.cos(theta)


def chiang(angles: PhaseAngles, fibre: HairFibre) -> Float[Array, " 3"]:
    """Return the scattering function of a fibre thinner than a pixel.

    The mean of `chiang_near` over all places across the fibre, by Gauss and Legendre.

    Args:
        angles: Inclinations and azimuth; they count towards the hair's tip.
        fibre: What the fibre is made of.
    """
    offsets, weights = np.polynomial.legendre.leggauss(OFFSETS)
    kind = fibre.absorption.dtype
    each = jax.vmap(chiang_near, (None, None, 0))
    found = each(angles, fibre, jnp.asarray(offsets, kind))
    return 0.5 * jnp.asarray(weights, kind) @ found


def inside(
    theta: Float[Array, ""], fibre: HairFibre, offset: Float[Array, ""]
) -> Inside:
    """Return how a ray goes on inside a fibre, and what comes out on each path."""
    sine, cosine = jnp.sin(theta), jnp.cos(theta)
    # Bravais: across the fibre, light bends as by another index.
    across = jnp.sqrt(fibre.ior**2 - sine**2) / cosine
    entry, refracted = jnp.arcsin(offset), jnp.arcsin(offset / across)
    slope = jnp.sqrt(1.0 - (sine / fibre.ior) ** 2)
    length = 2.0 * jnp.cos(refracted) / slope
    through = jnp.exp(-fibre.absorption * length)
    back = fresnel(cosine * jnp.sqrt(1.0 - offset**2), fibre.ior)
    straight = (1.0 - back) ** 2 * through
    turned = straight * through * back
    rest = turned * back * through / (1.0 - through * back)
    first = jnp.broadcast_to(back, through.shape)
    return Inside(entry, refracted, jnp.stack([first, straight, turned, rest]))


def longitudinal_width(roughness: Float[Array, ""]) -> Float[Array, ""]:
    """Return the variance of the longitudinal lobe of R."""
    root = 0.726 * roughness + 0.812 * roughness**2 + 3.7 * roughness**20
    return root**2


def logistic_scale(roughness: Float[Array, ""]) -> Float[Array, ""]:
    """Return the scale of the azimuthal lobes' logistic distribution."""
    fit = 0.265 * roughness + 1.194 * roughness**2 + 5.372 * roughness**22
    return math.sqrt(math.pi / 8.0) * fit


def longitudinal(
    theta: Float[Array, ""], middle: Float[Array, ""], variance: Float[Array, ""]
) -> Float[Array, ""]:
    r"""Return the longitudinal lobe $M_p$ of d'Eon et al. 2011, equation (7).

    Its integral over $\cos\theta\,d\theta$ is 1. With the scaled Bessel function no
    factor overflows, however narrow the lobe.

    Args:
        theta: Inclination of the light.
        middle: Inclination of the eye, tilted; beyond a pole it is on the other side.
        variance: Of the lobe.
    """
    a = jnp.abs(jnp.cos(theta) * jnp.cos(middle)) / variance
    b = jnp.sin(theta) * jnp.sin(middle) / variance
    # 1 / (2 v sinh(1 / v)) = exp(-1 / v) / (v (1 - exp(-2 / v))).
    front = 1.0 / (variance * (1.0 - jnp.exp(-2.0 / variance)))
    return front * jnp.exp(a - b - 1.0 / variance) * i0e(a)


def trimmed_logistic(x: Float[Array, ""], scale: Float[Array, ""]) -> Float[Array, ""]:
    r"""Return the density of the logistic distribution cut to $[-\pi, \pi]$.

    Args:
        x: Where, in $[-\pi, \pi]$.
        scale: Of the distribution.
    """
    small = jnp.exp(-jnp.abs(x) / scale)
    density = small / (scale * (1.0 + small) ** 2)
    return density / jnp.tanh(0.5 * jnp.pi / scale)
