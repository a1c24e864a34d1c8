r"""Where fewer hairs grow: a density of roots with which strands cover what masks say.

The hull is where hair can be, and strands fill it evenly. A parting, a thin crown or a
lock of its own show in the masks instead: strands hide pixels that are no hair. Each
strand is multiplied by the mean along it of what pixels ask for, $\min(1, 1/D)$ beside
the hair and $\max(1, \min(1/D, 3/2))$ within, where $D$ is what hides a pixel over what
would hide half of it: multiplicative updates as those of emission tomography [Shepp and
Vardi 1982, IEEE Transactions on Medical Imaging 1(2)]. The factors, smooth over the
scalp, are the density of the roots.
"""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from ..abreast import abreast
from ..capture.filters import square_means
from ..evaluate.coverage import (
    WIDTHS,
    best_width,
    drawn_pieces,
    ious_of,
    narrowest,
)
from ..evaluate.visibility import Sight
from ..model.maps import ScalpMaps
from ..model.strand import Hair
from .density import texel_means

# Strands that are looked at: each stands for a patch of scalp.
MOST = 4000
ROUNDS = 20
BLOCK = 2  # pixels a side that are one: masks are no better
# The most by which a round adds hair where masks have more than strands hide.
MOST_ADDED = 1.5
SMOOTH = 2.0  # texels, some 4 mm
# Roots at full density: masks that ask for so much of the densest spot ask for no less.
FULL = 0.5
THINNEST = 0.05
DENSEST = 0.95  # the quantile of the density that counts as the densest spot


class Covers(NamedTuple):
    """What strands would hide of a photograph.

    Attributes:
        hides: Row by row what a strand hides of each block of pixels, per metre of its
            width.
        wanted: Which blocks are hair.
    """

    hides: sparse.csr_matrix
    wanted: Bool[np.ndarray, " blocks"]


def thinned(maps: ScalpMaps, hair: Hair, sights: Sequence[Sight]) -> ScalpMaps:
    """Return maps with a density of roots at which strands cover the masks.

    Args:
        maps: What is on the scalp, with an even density, `TEXELS` a side.
        hair: Strands, as dense everywhere; none leave the density even.
        sights: The photographs that count, one or more.
    """
    if not len(hair.uv):
        return maps
    step = -(-len(hair.uv) // MOST)
    points = np.asarray(hair.strands, np.float64)[::step]
    uv = np.asarray(hair.uv, np.float64)[::step]
    factor = strand_factors(list(abreast(lambda one: covers(points, one), sights)))
    density = jnp.asarray(root_density(uv, factor), maps.density.dtype)
    return eqx.tree_at(lambda m: m.density, maps, density)


def covers(points: Float[np.ndarray, "strands knots 3"], sight: Sight) -> Covers:
    """Return what strands would hide of a photograph, block by block.

    Args:
        points: The strands, with equal counts of points, in metres.
        sight: The photograph, and what is behind its hair.
    """
    view, behind = sight
    rows, columns = (-(-size // BLOCK) for size in view.hair.shape)
    hides = sparse.csr_matrix((len(points), rows * columns))
    for strand, y, x, part in drawn_pieces(points, view.camera, behind):
        block = block_of(y, x, view.camera.width)
        entries = (part / BLOCK**2, (strand, block))
        hides += sparse.csr_matrix(entries, shape=hides.shape)
    share = square_means(view.hair[..., None].astype(np.float32), BLOCK)
    return Covers(hides, share.ravel() >= 0.5)


def block_of(
    y: Int[np.ndarray, "*pixels"], x: Int[np.ndarray, "*pixels"], width: int
) -> Int[np.ndarray, "*pixels"]:
    """Return the block of each pixel of a photograph so many pixels wide."""
    return (y // BLOCK) * -(-width // BLOCK) + x // BLOCK


def strand_factors(seen: Sequence[Covers]) -> Float[np.ndarray, " strands"]:
    """Return by how much each strand has to count for all to cover what is hair.

    Strands are no wider than covers the photographs as well as at the best while all
    count alike: wider ones hide no more of what masks show whole, but all that masks
    show in part, as shorn hair, would be too dense.

    Args:
        seen: What the strands hide of each photograph, one or more.
    """
    whole = np.sum([hides @ np.ones(len(wanted)) for hides, wanted in seen], axis=0)
    factor = np.ones(len(whole))
    width = narrowest(cover_by_width(seen, factor))
    for _ in range(ROUNDS):
        asked = np.zeros(len(whole))
        for hides, wanted in seen:
            hidden = hidden_by(hides, factor, width)
            ratio = 1.0 / np.maximum(hidden, 1e-9)
            within, beside = np.clip(ratio, 1.0, MOST_ADDED), np.minimum(ratio, 1.0)
            asked += hides @ np.where(wanted, within, beside)
        # Strands that no photograph shows are as they were.
        factor *= np.where(whole > 0.0, asked / np.maximum(whole, 1e-30), 1.0)
    return factor


def hidden_by(
    hides: sparse.csr_matrix, factor: Float[np.ndarray, " strands"], width: float
) -> Float[np.ndarray, " blocks"]:
    """Return what strands hide of each block, 1 where it is half of it.

    Args:
        hides: As in `Covers`.
        factor: By how much each strand counts.
        width: Of a strand, in metres.
    """
    return (hides.T @ factor) * width / np.log(2.0)


def width_of(seen: Sequence[Covers], factor: Float[np.ndarray, " strands"]) -> float:
    """Return the width at which strands cover the photographs best, in metres.

    Args:
        seen: What the strands hide of each photograph, one or more.
        factor: By how much each strand counts.
    """
    return best_width(cover_by_width(seen, factor)).width


def cover_by_width(
    seen: Sequence[Covers], factor: Float[np.ndarray, " strands"]
) -> list[Float[np.ndarray, " widths"]]:
    """Return the IoU with each photograph's mask at each of `WIDTHS`.

    Args:
        seen: What the strands hide of each photograph, one or more.
        factor: By how much each strand counts.
    """
    return [ious_of(hides.T @ factor, wanted, WIDTHS) for hides, wanted in seen]


def root_density(
    uv: Float[np.ndarray, "strands 2"], factor: Float[np.ndarray, " strands"]
) -> Float[np.ndarray, "texels texels"]:
    """Return the share of the roots that grow, smooth over the scalp.

    Args:
        uv: Roots of the strands, even over the scalp.
        factor: By how much each strand counts.
    """
    count, mean = texel_means(uv, factor, SMOOTH)
    rooted = count > 1e-3 * count.max()
    density = np.where(rooted, mean, np.inf)
    full = FULL * np.quantile(density[rooted], DENSEST)
    return np.clip(density / full, THINNEST, 1.0)
