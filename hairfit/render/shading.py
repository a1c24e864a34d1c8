"""Local shading of hair: how much light one fibre sends to the eye."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class Fibre(eqx.Module):
    """What hair is made of, for `kajiya_kay`. Linear RGB.

    Attributes:
        ambient: Share of light that comes back from all directions, $K_a$.
        diffuse: Colour of the diffuse reflection, $K_d$.
        specular: Colour of the highlight, $K_s$.
        shininess: Exponent of the highlight, $p$; above 1 for a smooth edge.
    """

    ambient: Float[Array, " 3"]
    diffuse: Float[Array, " 3"]
    specular: Float[Array, " 3"]
    shininess: Float[Array, ""]


def kajiya_kay(
    tangent: Float[Array, " 3"],
    to_light: Float[Array, " 3"],
    to_eye: Float[Array, " 3"],
    fibre: Fibre,
) -> Float[Array, " 3"]:
    r"""Return the light that a lit fibre sends to the eye [Kim02, (5-7) to (5-11)].

    $\Psi = K_a + K_d \sin(T, L) + K_s\,[\sin(T, L)\sin(T, V) - (T \cdot L)(T \cdot
    V)]^p$. Equation (5-9) has a plus, which holds for a `V` that runs away from the
    eye: a mirror turns $T \cdot L$ into its negative. Shadows are not part of it:
    multiply the last two terms with the transmittance.

    Args:
        tangent: Unit vector along the fibre; its sign does not matter.
        to_light: Unit vector from the fibre to the light.
        to_eye: Unit vector from the fibre to the eye.
        fibre: What the fibre is made of.
    """
    along_light, along_eye = tangent @ to_light, tangent @ to_eye
    across_light, across_eye = sine(along_light), sine(along_eye)
    mirror = across_light * across_eye - along_light * along_eye
    highlight = positive_power(mirror, fibre.shininess)
    return fibre.ambient + fibre.diffuse * across_light + fibre.specular * highlight


def sine(cosine: Float[Array, ""]) -> Float[Array, ""]:
    """Return the sine of an angle in [0, pi], with gradient 0 where it is 0."""
    square = 1.0 - cosine**2
    inside = square > 0.0
    # The root's gradient is infinite at 0: keep it from the untaken branch as well.
    return jnp.where(inside, jnp.sqrt(jnp.where(inside, square, 1.0)), 0.0)


def positive_power(
    base: Float[Array, ""], exponent: Float[Array, ""]
) -> Float[Array, ""]:
    """Return a power of the positive part of `base`, with gradient 0 beside it."""
    inside = base > 0.0
    return jnp.where(inside, jnp.where(inside, base, 1.0) ** exponent, 0.0)
