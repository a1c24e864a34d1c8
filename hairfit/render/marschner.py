r"""Light in a hair fibre, by Marschner et al. 2003: R, TT and TRT.

Marschner, Jensen, Cammarano, Worley, Hanrahan: Light scattering from human hair fibers.
Equation numbers are of that paper. `chiang` has what came after: lobes that keep all
energy, and the light of longer paths. This one is for comparison, and for its caustics.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from .chiang import HairFibre, longitudinal_width
from .dielectric import fresnel, inner_cosine
from .phase import PhaseAngles, wrapped

# Shifts and widths of the lobes of R, TT and TRT beside those of R (table 1).
SHIFTS = (1.0, -0.5, -1.5)
WIDTHS = (1.0, 0.5, 2.0)
# Of TRT's caustics (table 1): their width in radians, how bright they are, how far
# above an index of 2 they fade, and how wide the band across the fibre is that feeds
# them at most.
CAUSTIC, GLINT, FADE, WIDEST = 0.26, 0.5, 0.3, 0.5
# A ray that goes where its neighbours go would be infinitely bright.
LEAST_SLOPE = 1e-3


class Bend(NamedTuple):
    """A fibre as a plane across it sees it.

    Attributes:
        index: Index of refraction for light polarised across, after Bravais.
        parallel: The same for the other polarisation.
        absorption: Absorption of a ray at its slope, per radius, in RGB.
    """

    index: Float[Array, ""]
    parallel: Float[Array, ""]
    absorption: Float[Array, " 3"]


def marschner(angles: PhaseAngles, fibre: HairFibre) -> Float[Array, " 3"]:
    r"""Return $\sum_p M_p(\theta_h) N_p(\theta_d, \phi) / \cos^2\theta_d$.

    $M_p$ is a normal density of the light's inclination $2 \theta_h - \theta'$, so that
    a clear fibre sends on what it gets but for longer paths; as a density of $\theta_h$
    it would count all light twice.

    Args:
        angles: Inclinations and azimuth; they count towards the hair's tip.
        fibre: What the fibre is made of; its tilt moves the lobes as `chiang`'s does,
            its azimuthal roughness has no place here.
    """
    difference = 0.5 * (angles.theta_eye - angles.theta)
    bend = bend_at(difference, fibre)
    around = (
        reflected_once(angles.phi, bend),
        passed_through(angles.phi, bend),
        turned_once(angles.phi, bend),
    )
    turned = angles.theta + angles.theta_eye  # twice the half angle
    width = jnp.sqrt(longitudinal_width(fibre.roughness))
    total = jnp.zeros(3, fibre.absorption.dtype)
    for lobe, shift, scale in zip(around, SHIFTS, WIDTHS, strict=True):
        along = gaussian(turned - 2.0 * shift * fibre.tilt, scale * width)
        total = total + along * lobe
    return total / jnp.cos(difference) ** 2


def bend_at(difference: Float[Array, ""], fibre: HairFibre) -> Bend:
    """Return the fibre for rays at a difference angle (appendix B)."""
    cosine, sine = jnp.cos(difference), jnp.sin(difference)
    root = jnp.sqrt(fibre.ior**2 - sine**2)
    slope = root / fibre.ior
    return Bend(root / cosine, fibre.ior**2 * cosine / root, fibre.absorption / slope)


def attenuation(path: int, entry: Float[Array, ""], bend: Bend) -> Float[Array, " 3"]:
    """Return what is left of a ray on its path inside (equation 8)."""
    back = fresnel(jnp.cos(entry), bend.index, bend.parallel)
    if path == 0:
        return jnp.broadcast_to(back, bend.absorption.shape)
    inner = inner_cosine(jnp.sin(entry) ** 2, bend.index)
    through = jnp.exp(-2.0 * path * inner * bend.absorption)
    return (1.0 - back) ** 2 * back ** (path - 1) * through


def reflected_once(phi: Float[Array, ""], bend: Bend) -> Float[Array, " 3"]:
    """Return N_R: a mirror sends light at `entry` back by twice that."""
    entry = 0.5 * jnp.abs(wrapped(phi))
    return 0.25 * jnp.cos(entry) * attenuation(0, entry, bend)


def passed_through(phi: Float[Array, ""], bend: Bend) -> Float[Array, " 3"]:
    """Return N_TT, by the one root of the cubic of equation (10)."""
    critical = jnp.arcsin(1.0 / bend.index)
    linear, cubic = 6.0 * critical / jnp.pi - 2.0, -8.0 * critical / jnp.pi**3
    # Light leaves about the far side: the azimuth from there.
    beyond = jnp.pi - jnp.abs(wrapped(phi))
    entry = only_root(linear / cubic, beyond / cubic)
    return band(1, entry, bend, linear + 3.0 * cubic * entry**2)


def turned_once(phi: Float[Array, ""], bend: Bend) -> Float[Array, " 3"]:
    """Return N_TRT, its caustics replaced by smooth ones (algorithm 2)."""
    critical = jnp.arcsin(1.0 / bend.index)
    linear, cubic = 12.0 * critical / jnp.pi - 2.0, -16.0 * critical / jnp.pi**3
    at = jnp.abs(wrapped(phi))
    total = jnp.zeros(3, bend.absorption.dtype)
    for entry, there in cubic_roots(linear / cubic, -at / cubic):
        found = band(2, entry, bend, linear + 3.0 * cubic * entry**2)
        total = total + jnp.where(there, found, 0.0)
    folds = bend.index < 2.0
    offset = jnp.sqrt(jnp.where(folds, (4.0 - bend.index**2) / 3.0, 0.0))
    entry = jnp.arcsin(offset)
    where = 4.0 * jnp.arcsin(offset / bend.index) - 2.0 * entry
    curve = 4.0 * offset / (bend.index**2 - offset**2) ** 1.5
    curve = jnp.abs(curve - 2.0 * offset / (1.0 - offset**2) ** 1.5)
    wide = jnp.where(
        folds,
        jnp.minimum(WIDEST, 2.0 * jnp.sqrt(2.0 * CAUSTIC / (curve + 1e-6))),
        WIDEST,
    )
    above = jnp.clip((bend.index - 2.0) / FADE, 0.0, 1.0)
    share = 1.0 - above**2 * (3.0 - 2.0 * above)
    peaks = gaussian(at - where, CAUSTIC) + gaussian(at + where, CAUSTIC)
    for side in (at - where, at + where):
        total = total * (1.0 - share * jnp.exp(-0.5 * (side / CAUSTIC) ** 2))
    return total + share * GLINT * attenuation(2, entry, bend) * wide * peaks


def band(
    path: int, entry: Float[Array, ""], bend: Bend, slope: Float[Array, ""]
) -> Float[Array, " 3"]:
    """Return the light of rays about one that leaves in a direction (equation 8).

    Args:
        path: Segments inside.
        entry: Angle of incidence of the ray.
        bend: The fibre.
        slope: How the azimuth where it leaves moves with `entry`.
    """
    inside = jnp.abs(entry) < 0.5 * jnp.pi
    safe = jnp.where(inside, entry, 0.0)
    spread = jnp.maximum(jnp.abs(slope), LEAST_SLOPE)
    found = attenuation(path, safe, bend) * jnp.cos(safe) / (2.0 * spread)
    return jnp.where(inside, found, 0.0)


def cubic_roots(p: Float[Array, ""], q: Float[Array, ""]):
    """Return the real roots of x^3 + p x + q with whether there are such."""
    folds = p < 0.0
    root = jnp.sqrt(jnp.where(folds, -p, 1.0) / 3.0)
    ratio = -0.5 * q / root**3
    three = folds & (jnp.abs(ratio) < 1.0)
    angle = jnp.arccos(jnp.where(three, ratio, 0.0)) / 3.0
    found = [
        (2.0 * root * jnp.cos(angle - 2.0 * jnp.pi * k / 3.0), three) for k in range(3)
    ]
    beyond = jnp.maximum(jnp.abs(ratio), 1.0 + 1e-6)
    alone = 2.0 * root * jnp.sign(ratio) * jnp.cosh(jnp.arccosh(beyond) / 3.0)
    steady = only_root(jnp.where(folds, 1.0, p), q)
    return [*found, (jnp.where(folds, alone, steady), ~three)]


def only_root(p: Float[Array, ""], q: Float[Array, ""]) -> Float[Array, ""]:
    """Return the one real root of x^3 + p x + q for p > 0."""
    root = jnp.sqrt(jnp.maximum(p, 1e-9) / 3.0)
    return -2.0 * root * jnp.sinh(jnp.arcsinh(0.5 * q / root**3) / 3.0)


def gaussian(x: Float[Array, ""], width: Float[Array, ""] | float) -> Float[Array, ""]:
    """Return the density of the normal distribution."""
    return jnp.exp(-0.5 * (x / width) ** 2) / (width * jnp.sqrt(2.0 * jnp.pi))
