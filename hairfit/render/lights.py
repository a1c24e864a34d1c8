"""Lights: far away, or at a place."""

import equinox as eqx
from jaxtyping import Array, Float


class DistantLight(eqx.Module):
    """A light so far away that its rays are parallel. Linear RGB.

    Attributes:
        to_light: Unit vector towards it.
        colour: Its light on a surface that faces it.
    """

    to_light: Float[Array, " 3"]
    colour: Float[Array, " 3"]


class PointLight(eqx.Module):
    """A small lamp. Linear RGB.

    Attributes:
        position: Where it is, in metres.
        intensity: Its light on a surface that faces it one metre away.
    """

    position: Float[Array, " 3"]
    intensity: Float[Array, " 3"]
