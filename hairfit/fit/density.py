"""How densely roots stand on a scalp, as a map that is painted on it."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import ndimage
from scipy.spatial import KDTree

from ..model.curve import catmull_rom_weights
from ..model.maps import ScalpMaps, even_maps
from ..model.scalp import SIDE, Scalp

TEXELS = 160
# The densest spot counts as no denser than so many times the mean: roots are sampled by
# rejection.
DENSEST = 30.0
NEIGHBOURS = 4


def root_spacing(uv: Float[np.ndarray, "strands 2"]) -> float:
    """Return the typical distance between neighbouring roots, in scalp space."""
    if len(uv) < 2:
        return 1.0 / TEXELS
    # Roots in one place, such as those of a pasted tuft, are one.
    return max(neighbour_distance(uv), 1e-3)


def neighbour_distance(points: Float[np.ndarray, "points axes"]) -> float:
    """Return the typical distance between neighbours, 0 for a lone point.

    It is that to the fourth neighbour, in the median: hairs in tufts are closer.
    """
    count = min(NEIGHBOURS, len(points) - 1)
    if count < 1:
        return 0.0
    return float(np.median(KDTree(points).query(points, k=count + 1)[0][:, -1]))


def density_maps(scalp: Scalp, uv: Float[np.ndarray, "strands 2"]) -> ScalpMaps:
    """Return maps with the density of roots, smooth over the distance between them.

    Args:
        scalp: The scalp.
        uv: Roots in scalp space.
    """
    spacing = root_spacing(uv) * (TEXELS - 1)
    width = spacing if spacing > 1.0 else 0.0
    count, area = (
        ndimage.gaussian_filter(x, 0.5 * width, mode="nearest")
        for x in (spread(uv), texel_areas(scalp))
    )
    density = count / np.maximum(area, 1e-3 * area.max())
    mean = count.sum() / area[count > 1e-3 * count.max()].sum()
    density = np.minimum(density / (DENSEST * mean), 1.0)
    density /= density.max()
    maps = even_maps(TEXELS, TEXELS)
    kind = scalp.control.dtype
    maps = jax.tree.map(lambda leaf: leaf.astype(kind), maps)
    return eqx.tree_at(lambda m: m.density, maps, jnp.asarray(density, kind))


def spread(
    uv: Float[np.ndarray, "strands 2"],
    amount: Float[np.ndarray, " strands"] | float = 1.0,
) -> Float[np.ndarray, "texels texels"]:
    """Return the number of roots at each texel, each shared among its four corners.

    Args:
        uv: The roots.
        amount: As how many each counts.
    """
    at = np.clip(uv, 0.0, 1.0) * (TEXELS - 1)
    low = np.clip(np.floor(at).astype(int), 0, TEXELS - 2)
    far = at - low
    count = np.zeros((TEXELS, TEXELS))
    for i, j in np.ndindex(2, 2):
        share = np.abs(1 - i - far[:, 0]) * np.abs(1 - j - far[:, 1])
        np.add.at(count, (low[:, 0] + i, low[:, 1] + j), amount * share)
    return count


class TexelMeans(NamedTuple):
    """What roots have around each texel.

    Attributes:
        count: How many roots there are.
        mean: What they have in the mean; 0 where there are none.
    """

    count: Float[np.ndarray, "texels texels"]
    mean: Float[np.ndarray, "texels texels"]


def texel_means(
    uv: Float[np.ndarray, "strands 2"],
    amount: Float[np.ndarray, " strands"],
    smooth: float = 0.0,
) -> TexelMeans:
    """Return the means of what roots have, around each texel.

    Args:
        uv: The roots.
        amount: What each has.
        smooth: Standard deviation of the Gaussian around a texel, in texels.
    """
    count, total = (
        ndimage.gaussian_filter(x, smooth, mode="nearest")
        for x in (spread(uv), spread(uv, amount))
    )
    return TexelMeans(count, total / np.maximum(count, 1e-30))


def texel_areas(scalp: Scalp) -> Float[np.ndarray, "texels texels"]:
    """Return the area of the scalp around each texel, in square metres."""
    side = jnp.linspace(0.0, 1.0, 2 * TEXELS - 1, dtype=scalp.control.dtype)
    weights = catmull_rom_weights(SIDE, side)
    p = np.asarray(jnp.einsum("ai,bj,ijk->abk", weights, weights, scalp.control))
    cross = np.cross(p[1:, 1:] - p[:-1, :-1], p[:-1, 1:] - p[1:, :-1])
    quarter = np.pad(0.5 * np.linalg.norm(cross, axis=-1), 1)
    return quarter.reshape(TEXELS, 2, TEXELS, 2).sum(axis=(1, 3))
