"""The scalp: a tensor-product Catmull-Rom patch wrapped over the head."""

import equinox as eqx
from jaxtyping import Array, Float


class Scalp(eqx.Module):
    """The region of a head where hair grows [Kim02, section 4.3]. Metres.

    Attributes:
        control: Control points; the patch runs through all of them, `control[i, j]` at
            `u = i / 12`, `v = j / 12`.
    """

    control: Float[Array, "13 13 3"]
