"""Generalized cylinders: contours swept along the skeleton of a hair cluster."""

import equinox as eqx
from jaxtyping import Array, Float


class GeneralizedCylinder(eqx.Module):
    r"""One hair cluster, from scalp to tip [Kim02, section 4.2]. Metres, radians.

    A point is $V(r, \theta, t) = C(t) + (S_N x + H y)\,\bar N(t) + S_B y\,\bar B(t)$ with
    $x = r R(\theta, t)\cos(\theta + W)$ and $y = r R(\theta, t)\sin(\theta + W)$. With
    $H = 0$ this is equation (4-4). The shear $H$ completes scale and twist to any
    linear map of the cross-section, which artists' grooms need.

    Attributes:
        skeleton: Control points of the Catmull-Rom curve $C$, at $t = k / (knots - 1)$.
        normal: Direction of $\theta = 0$ at the root; made perpendicular to the tangent.
        radius: Global radius of the contour at each knot.
        offset: Offsets of the contour from `radius`, at 32 even angles from 0.
        scale: $S_N$ and $S_B$.
        twist: $W$.
        shear: $H$.
    """

    skeleton: Float[Array, "knots 3"]
    normal: Float[Array, " 3"]
    radius: Float[Array, " knots"]
    offset: Float[Array, "knots 32"]
    scale: Float[Array, "knots 2"]
    twist: Float[Array, " knots"]
    shear: Float[Array, " knots"]
