"""Phase functions as tables, for engines that cannot afford to compute them."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .phase import PhaseAngles

Phase = Callable[[PhaseAngles], Float[Array, " 3"]]


class PhaseTable(NamedTuple):
    r"""What hair sends to the eye of a light that a white matt surface reflects as 1.

    That is $\pi f \cos\theta$ of a scattering function $f$.

    Attributes:
        values: Linear RGB at inclinations of the eye, of the light, both from
            $-\pi/2$ to $\pi/2$ at the middles of equal steps, and azimuths from 0 to
            $\pi$, alike.
        forward: Share of the light that goes on, to the side away from the light: the
            mean over all inclinations.
        backward: Share that comes back to the light's side.
    """

    values: Float[np.ndarray, "eyes lights azimuths 3"]
    forward: Float[np.ndarray, " 3"]
    backward: Float[np.ndarray, " 3"]


def phase_table(phase: Phase, inclinations: int = 64, azimuths: int = 64) -> PhaseTable:
    r"""Return a table of a scattering function that is even in the azimuth.

    Args:
        phase: What returns $f$ for angles, as `chiang` with a fibre does.
        inclinations: Steps of each inclination.
        azimuths: Steps of the azimuth.
    """
    theta = (np.arange(inclinations) + 0.5) / inclinations * np.pi - np.pi / 2.0
    phi = (np.arange(azimuths) + 0.5) / azimuths * np.pi
    eye, light, turn = (
        jnp.asarray(x.reshape(-1))
        for x in np.meshgrid(theta, theta, phi, indexing="ij")
    )
    values = jax.lax.map(
        lambda x: phase(PhaseAngles(theta=x[1], theta_eye=x[0], phi=x[2])),
        (eye, light, turn),
        batch_size=4096,
    )
    shape = inclinations, inclinations, azimuths, 3
    f = np.maximum(np.asarray(values, np.float64).reshape(shape), 0.0)
    # What is sent in all directions of a light: both halves of the azimuth.
    step = np.pi / inclinations, 2.0 * np.pi / azimuths
    sent = f * (np.cos(theta) ** 2)[:, None, None, None] * step[0] * step[1]
    weight = np.cos(theta) / np.cos(theta).sum()
    ahead = phi > np.pi / 2.0
    forward = np.einsum("elac,l->c", sent[:, :, ahead], weight)
    backward = np.einsum("elac,l->c", sent[:, :, ~ahead], weight)
    shine = np.pi * f * np.cos(theta)[None, :, None, None]
    return PhaseTable(shine.astype(np.float32), forward, backward)


def scattered_back(table: PhaseTable) -> Float[np.ndarray, " 3"]:
    r"""Return the share of light that neighbouring hairs send back to a lit hair.

    $\bar A_b = \frac{a_b a_f^2}{1 - a_f^2} + \frac{a_b^3 a_f^2}{(1 - a_f^2)^3}$: light
    that turns once, or three times, among hairs and goes on through all others [Zinke
    et al. 2008, *Dual scattering approximation*, equations (12) to (14)].
    """
    on, back = np.minimum(table.forward, 0.95) ** 2, table.backward
    return back * on / (1.0 - on) + back**3 * on / (1.0 - on) ** 3
