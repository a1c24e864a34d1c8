"""The hair tree: clusters under clusters, rooted on a scalp."""

import equinox as eqx
from jaxtyping import Array, Float

from .cylinder import GeneralizedCylinder
from .scalp import Scalp


class ScalpContour(eqx.Module):
    """Where a cluster is rooted: a star-shaped contour in scalp space (u, v).

    Attributes:
        centre: (u, v) of the centre.
        radius: Global radius, in scalp space.
        offset: Offsets from `radius`, at 32 even angles from 0.
    """

    centre: Float[Array, " 2"]
    radius: Float[Array, ""]
    offset: Float[Array, " 32"]


class HairTree(eqx.Module):
    """A hairstyle. All clusters are stacked: their arrays have a leading axis.

    Attributes:
        scalp: The surface that all hair grows from.
        contour: The scalp contours of all clusters, stacked.
        cylinder: The generalized cylinders of all clusters, stacked.
        length_variation: Share `k` of the length by which tips vary, in [0, 1).
        parent: Index of each cluster's parent, -1 for root clusters. Parents stand
            before their children.
    """

    scalp: Scalp
    contour: ScalpContour
    cylinder: GeneralizedCylinder
    length_variation: Float[Array, " clusters"]
    parent: tuple[int, ...] = eqx.field(static=True)
