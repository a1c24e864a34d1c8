r"""A fibre of one clear layer, simulated ray by ray [Kim02, section 5.5.2]."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, ScalarLike

from .dielectric import fresnel
from .phase import wrapped

# Rays are followed until so little is left of them in all.
LEAST = 1e-6
MOST_BOUNCES = 400


class ScatterTable(NamedTuple):
    r"""How light that falls across a fibre leaves it.

    Attributes:
        edges: Azimuths from the light's direction, from $-\pi$ to $\pi$.
        density: Light that leaves between two of them, per radian; its integral is 1.
    """

    edges: Float[np.ndarray, " edges"]
    density: Float[np.ndarray, " bins"]


reflected_shares = jax.jit(jax.vmap(fresnel, (0, None)))


def simulate_layer(
    ior: float, *, rays: int = 1_000_000, bins: int = 360, seed: int = 0
) -> ScatterTable:
    """Return the phase function of a clear circle by Monte Carlo.

    Rays of parallel light meet the circle at even offsets, chosen at random. Fresnel's
    reflectance is the chance that a ray is reflected, Snell's law bends the others, and
    where a ray leaves it is counted: the three rules of section 5.5.2. At index 1.5
    most goes on, and two small peaks stand diagonally on the light's side (figure
    5-11b): the rainbows of one reflection inside.

    Args:
        ior: Index of refraction, above 1.
        rays: Number of rays.
        bins: Number of azimuths.
        seed: Of the rays.

    Raises:
        ValueError: If the index is not above 1, or there is no ray or no bin.
    """
    if not ior > 1.0 or min(rays, bins) < 1:
        raise ValueError(
            f"a fibre refracts with an index above 1, by at least one ray and bin, got "
            f"{ior}, {rays} and {bins}."
        )
    rng = np.random.default_rng(seed)
    entry = np.arcsin(rng.uniform(-1.0, 1.0, rays))
    refracted = np.arcsin(np.sin(entry) / ior)
    back = np.asarray(reflected_shares(jnp.cos(entry), ior), np.float64)
    edges = np.linspace(-np.pi, np.pi, bins + 1)
    counts = np.zeros(bins)
    # By symmetry the chance of reflection inside is the same at every bounce.
    inside = rng.uniform(size=rays) >= back
    counts += count(-2.0 * entry[~inside], edges)
    entry, refracted, back = entry[inside], refracted[inside], back[inside]
    for bounce in range(1, MOST_BOUNCES):
        stays = rng.uniform(size=len(entry)) < back
        leaves = 2.0 * bounce * refracted - 2.0 * entry + bounce * np.pi
        counts += count(leaves[~stays], edges)
        entry, refracted, back = entry[stays], refracted[stays], back[stays]
        if len(entry) <= LEAST * rays:
            break
    return ScatterTable(edges, counts / (counts.sum() * np.diff(edges)))


def count(azimuth: Float[np.ndarray, " rays"], edges) -> Float[np.ndarray, " bins"]:
    """Return how many rays leave between the edges."""
    turned = np.mod(azimuth + np.pi, 2.0 * np.pi) - np.pi
    return np.histogram(turned, edges)[0].astype(float)


def look_up(table: ScatterTable, phi: ScalarLike) -> Float[Array, ""]:
    """Return a table's density at one azimuth, linear between the bins' middles.

    Args:
        table: The table.
        phi: Azimuth of the eye from the light, in radians.
    """
    middle = 0.5 * (table.edges[1:] + table.edges[:-1])
    at = wrapped(phi)
    return jnp.interp(
        at,
        jnp.asarray(middle, at.dtype),
        jnp.asarray(table.density, at.dtype),
        period=2.0 * np.pi,
    )
