"""A tree that stands a little beside the hair that photographs show."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from ball_hair import RADIUS, ball, dome, hull_where, photograph, ring
from jaxtyping import Array, Float

from hairfit.fit.evidence import Field
from hairfit.fit.hull import Hull
from hairfit.fit.refine import Photographs
from hairfit.fit.residuals import photo_maps
from hairfit.fit.samples import Samples
from hairfit.fit.volume import HairVolume, hair_volume
from hairfit.model import (
    HairTree,
    ScalpContour,
    find_owner,
    grow_strands,
    plant,
    sample_roots,
)

ASIDE = (0.004, 0.0, -0.003)  # metres from the tree to the hair


class Case(NamedTuple):
    """All that `refine` takes, and the hull."""

    tree: HairTree
    samples: Samples
    photographs: Photographs
    volume: HairVolume
    places: Float[np.ndarray, "places 3"]
    hull: Hull

    def grown(self, tree: HairTree, points: int = 12) -> Float[Array, "s p 3"]:
        """Return the samples' strands of a tree."""
        whole = jnp.ones(len(self.samples.owner), self.samples.uv.dtype)
        return grow_strands(tree, *self.samples, whole, points)


def refine_case(strands: int, knots: int, views: int) -> Case:
    """Return two root clusters and a leaf, seen by photographs."""
    contour = jax.vmap(ScalpContour)(
        jnp.array([[0.35, 0.4], [0.65, 0.6], [0.6, 0.6]]),
        jnp.array([0.3, 0.3, 0.2]),
        jnp.zeros((3, 32)),
    )
    planted = jax.vmap(lambda c: plant(dome(), c, 0.1, knots))(contour)
    tree = HairTree(dome(), contour, planted, jnp.zeros(3), (-1, -1, 1))
    uv = sample_roots(tree.scalp, 3 * strands, jax.random.key(2))
    owner = np.asarray(find_owner(tree, uv))
    held = np.resize(np.flatnonzero(owner >= 0), strands)
    samples = Samples(jnp.asarray(uv)[held], jnp.asarray(owner[held]))
    grown = grow_strands(tree, *samples, jnp.ones(strands), 12)
    true = np.asarray(grown, float) + ASIDE
    taken = photograph(true, ring(views), ball(), radius_px=1.5)
    maps = photo_maps(taken.views, taken.maps, taken.depths)
    hull = hull_where(
        lambda p: np.linalg.norm(p, axis=1) > RADIUS, [-0.2] * 3, [0.2] * 3, 0.02
    )
    nothing = np.zeros(hull.grid.shape)
    volume = hair_volume(hull, Field(np.zeros((*nothing.shape, 3)), nothing))
    seen = Photographs(taken.views, taken.depths, maps)
    return Case(tree, samples, seen, volume, true.reshape(-1, 3), hull)
