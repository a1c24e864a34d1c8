r"""Phase functions of one fibre, in three angles [Kim02, sections 5.3 to 5.5].

The angles are those of figure 5-4: the inclinations $\theta$ and $\theta'$ of the
directions to the light and to the eye from the plane across the fibre, positive
towards its tangent, and the azimuth $\phi'$ between them in that plane.
"""

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, ScalarLike

from .shading import Fibre, positive_power

# Below this share of a unit vector nothing is left across the fibre.
TINY = 1e-12


class PhaseAngles(NamedTuple):
    r"""Where light and eye are about a fibre, in radians.

    Attributes:
        theta: Inclination of the light, from $-\pi/2$ to $\pi/2$.
        theta_eye: Inclination of the eye.
        phi: Azimuth of the eye from the light, from 0 to $\pi$.
    """

    theta: Float[Array, ""]
    theta_eye: Float[Array, ""]
    phi: Float[Array, ""]


def phase_angles(
    tangent: Float[Array, " 3"],
    to_light: Float[Array, " 3"],
    to_eye: Float[Array, " 3"],
) -> PhaseAngles:
    r"""Return the three angles of unit vectors [Kim02, section 5.5.4].

    The thesis has $\theta = \cos^{-1}(N \cdot L)$, $\theta' = \cos^{-1}(N \cdot V)$ and
    $\phi' = \cos^{-1}(N \cdot v)$ with $v$ the projection of $V$ across the fibre. The
    first two lose their signs, so that a mirror could not be told from its opposite;
    the second holds only for $\phi' = 0$; in the third, $v$ must have length 1.
    Derived from figure 5-4: $\sin\theta = T \cdot L$, $\sin\theta' = T \cdot V$ and
    $\tan\phi' = |l \times v| / (l \cdot v)$.

    A direction along the fibre has no azimuth: then $\phi'$ is 0.

    Args:
        tangent: Unit vector along the fibre.
        to_light: Unit vector from the fibre to the light.
        to_eye: Unit vector from the fibre to the eye.
    """
    along, along_eye = tangent @ to_light, tangent @ to_eye
    across, across_eye = to_light - along * tangent, to_eye - along_eye * tangent
    turn = jnp.cross(across, across_eye) @ tangent
    ahead = across @ across_eye
    some = turn**2 + ahead**2 > TINY
    phi = jnp.abs(jnp.arctan2(jnp.where(some, turn, 0.0), jnp.where(some, ahead, 1.0)))
    return PhaseAngles(inclination(along), inclination(along_eye), phi)


def inclination(sine: Float[Array, ""]) -> Float[Array, ""]:
    """Return the angle of a sine, with gradient 0 where rounding leaves none."""
    inside = jnp.abs(sine) < 1.0
    flat = jnp.sign(sine) * (jnp.pi / 2)
    return jnp.where(inside, jnp.arcsin(jnp.where(inside, sine, 0.0)), flat)


def kajiya_kay_phase(angles: PhaseAngles, fibre: Fibre) -> Float[Array, " 3"]:
    r"""Return Kajiya's and Kay's phase function [Kim02, (5-10) and (5-11)].

    $p = K_a + K_d \cos\theta + K_s \cos^p(\theta + \theta')$. The thesis prints
    $\theta - \theta'$, as if $V$ ran away from the eye: see `kajiya_kay`.

    Args:
        angles: The angles.
        fibre: What the fibre is made of.
    """
    return fibre.ambient + lit_along(angles, fibre)


def lit_along(angles: PhaseAngles, fibre: Fibre) -> Float[Array, " 3"]:
    r"""Return the part of (5-11) that light makes, $p'(\theta, \theta')$ of (5-24)."""
    highlight = positive_power(
        jnp.cos(angles.theta + angles.theta_eye), fibre.shininess
    )
    return fibre.diffuse * jnp.cos(angles.theta) + fibre.specular * highlight


class Directionality(eqx.Module):
    r"""How a fibre tells light in front from light behind, for `goldman_phase`.

    Attributes:
        reflect: $\rho_{reflect}$, of light from the eye's side.
        transmit: $\rho_{transmit}$, of light from behind.
    """

    reflect: Float[Array, " 3"]
    transmit: Float[Array, " 3"]


def goldman_phase(
    angles: PhaseAngles, fibre: Fibre, side: Directionality
) -> Float[Array, " 3"]:
    r"""Return Goldman's phase function [Kim02, (5-12) to (5-14)].

    $p = K_a + f_{dir} (\Psi_{diffuse} + \Psi_{specular})$ with $f_{dir} = \frac{1 +
    \kappa}{2} \rho_{reflect} + \frac{1 - \kappa}{2} \rho_{transmit}$. $\kappa$ is the
    cosine between $T \times L$ and $T \times V$, which are the projections of $L$ and
    $V$ across the fibre, turned by a right angle: $\kappa = \cos\phi'$.

    Equations (5-15) to (5-18) put $V = (\sin\theta' \cos\phi', \cos\theta', \sin\theta'
    \sin\phi')$, which has $\theta'$ count from the normal instead of from the plane
    across the fibre, so that $\kappa$ depends on both angles. In the frame of figure
    5-4 $V = (\sin\theta', \cos\theta' \cos\phi', \cos\theta' \sin\phi')$.

    Args:
        angles: The angles.
        fibre: What the fibre is made of.
        side: What comes back on either side. Equal shares of 1 give Kajiya and Kay.
    """
    kappa = jnp.cos(angles.phi)
    share = 0.5 * ((1.0 + kappa) * side.reflect + (1.0 - kappa) * side.transmit)
    return fibre.ambient + share * lit_along(angles, fibre)


class Lobes(eqx.Module):
    r"""The lobes of the thesis's empirical model.

    Attributes:
        reflect: $\rho_r$, of the backward lobe.
        transmit: $\rho_t$, of the forward lobe.
        sharpness: $k \ge 1$, how narrow the forward lobe is.
    """

    reflect: Float[Array, " 3"]
    transmit: Float[Array, " 3"]
    sharpness: Float[Array, ""]


def reflected(phi: ScalarLike) -> Float[Array, ""]:
    r"""Return the backward lobe $R(\phi') = \cos(\phi' / 2)$ [Kim02, (5-21)].

    Light falls as $\cos\phi$ onto the half of the circle that faces it, (5-20), and a
    mirror at $\phi$ sends it towards $2 \phi$.
    """
    return jnp.cos(0.5 * wrapped(phi))


def transmitted(phi: ScalarLike, sharpness: ScalarLike) -> Float[Array, ""]:
    r"""Return the forward lobe $T(\phi') = \cos(k (\phi' - \pi))$ [Kim02, (5-22)].

    It ends where it is 0, at $\pi / (2 k)$ beside the light's way.
    """
    away = jnp.pi - jnp.abs(wrapped(phi))
    inside = sharpness * away < 0.5 * jnp.pi
    return jnp.where(inside, jnp.cos(jnp.where(inside, sharpness * away, 0.0)), 0.0)


def wrapped(phi: ScalarLike) -> Float[Array, ""]:
    r"""Return an angle in $[-\pi, \pi)$."""
    return jnp.mod(jnp.asarray(phi) + jnp.pi, 2.0 * jnp.pi) - jnp.pi


def empirical_phase(
    angles: PhaseAngles, fibre: Fibre, lobes: Lobes
) -> Float[Array, " 3"]:
    r"""Return the thesis's empirical phase function [Kim02, (5-19) to (5-24)].

    $p = K_a + (K_d \cos\theta + K_s \cos^p(\theta + \theta'))\,(\rho_r R(\phi') +
    \rho_t T(\phi'))$. The thesis has $\rho_r$ and $\rho_t$ in (5-21) and (5-22) and
    once more in (5-23), which would square them; figure 5-9 has them once.

    Args:
        angles: The angles.
        fibre: What the fibre is made of.
        lobes: How it sends light back and on.
    """
    back = lobes.reflect * reflected(angles.phi)
    on = lobes.transmit * transmitted(angles.phi, lobes.sharpness)
    return fibre.ambient + lit_along(angles, fibre) * (back + on)
