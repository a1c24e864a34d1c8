"""Level of detail: strands, segments and opacity, and cuts through the tree.

Thesis, section 4.7. All of it is topology and runs on the host, outside `jit`.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, UInt32

from .cylinder import GeneralizedCylinder, cylinder_knots
from .select import Matrix, project
from .tree import HairTree, leaves, take

# Angles at which the width of a contour is measured: pairs of opposite points.
PAIRS = 8


@dataclasses.dataclass(frozen=True)
class Detail:
    """In how much detail hair is drawn. The defaults are those of figure 4-23, left.

    Attributes:
        strands: Number of strands.
        segments: Segments of each strand.
        opacity: Alpha of a strand, above 0 and up to 1.
        width: Width of a strand, in metres.
    """

    strands: int = 20_000
    segments: int = 60
    opacity: float = 0.3
    width: float = 0.0001

    def __post_init__(self):
        if min(self.strands, self.segments) < 1:
            raise ValueError(
                f"hair needs a strand and a segment at least, got {self.strands} "
                f"strands of {self.segments} segments."
            )
        if not (0.0 < self.opacity <= 1.0 and self.width > 0.0):
            raise ValueError(
                f"hair needs an opacity above 0 and up to 1 and a positive width, got "
                f"{self.opacity} and {self.width} m."
            )

    @property
    def coverage(self) -> float:
        """What stays the same between levels: strands x width x opacity, in metres."""
        return self.strands * self.width * self.opacity


def with_strands(detail: Detail, strands: int) -> Detail:
    """Return a level with fewer or more strands that cover as much.

    Cook et al., *Stochastic Simplification of Aggregate Detail* (2007): what is left
    out is made up for by what stays. Fewer strands are more opaque, as in figure 4-23;
    once they are opaque, they are wider.

    Args:
        detail: A level.
        strands: The new number of strands.
    """
    needed = detail.opacity * detail.strands / strands
    return dataclasses.replace(
        detail,
        strands=strands,
        opacity=min(needed, 1.0),
        width=detail.width * max(needed, 1.0),
    )


def fade_order(
    count: int, key: PRNGKeyArray | UInt32[Array, " 2"]
) -> Int[np.ndarray, " count"]:
    """Return a random order of strands, in which they come in as detail grows.

    Of strands in this order every level draws the first ones: the strands of a coarser
    level are a prefix of those of a finer one, spread as evenly, and do not change.
    Strands of `sample_strands` are in such an order already.

    Args:
        count: Number of strands.
        key: Randomness; keep it for all levels.
    """
    return np.asarray(jax.random.permutation(key, count))


def segments_needed(
    strands: Float[np.ndarray, "strands points 3"] | Float[Array, "strands points 3"],
    image_from_world: Matrix,
    pixels: float = 0.5,
) -> Int[np.ndarray, " strands"]:
    r"""Return how many segments draw each strand to within an error in pixels.

    A chord over `m` segments of a polyline leaves it by at most
    $(m^2 + 1) / 8$ times the largest second difference of its points, here in the
    picture. (For a smooth curve this is $h^2 |C''| / 8$; the 1 is for ends of chords
    that lie between points.) So long, close and strongly bent strands get many
    segments, and what is far, short or straight as few as one. Strands are then grown
    or resampled at even steps with these numbers, or all with their largest.

    Args:
        strands: Strands in full detail, in metres.
        image_from_world: The camera, as `select.project` takes it.
        pixels: The error, in pixels.

    Returns:
        The numbers of segments, from 1 to that of `strands`; strands that are partly
        behind the camera keep all of theirs.

    Raises:
        ValueError: If `pixels` is not positive.
    """
    must_be_positive(pixels)
    full = strands.shape[1] - 1
    pixel = project(image_from_world, np.asarray(strands)).pixel
    bend = np.linalg.norm(np.diff(pixel, n=2, axis=1), axis=-1).max(axis=1, initial=0.0)
    chord = np.sqrt(np.maximum(8.0 * pixels / np.maximum(bend, 1e-9) - 1.0, 1.0))
    needed = np.ceil(full / np.nan_to_num(chord, nan=1.0) - 1e-9)
    return np.clip(needed, 1, max(full, 1)).astype(int)


def contour_widths(
    tree: HairTree, image_from_world: Matrix
) -> Float[np.ndarray, " clusters"]:
    """Return how wide each cluster looks to a camera, in pixels.

    The largest diameter of its contours at the knots, through their centres, as they
    are projected. A cluster behind the camera has no width, one that reaches behind it
    is infinitely wide.

    Args:
        tree: The tree.
        image_from_world: The camera, as `select.project` takes it.
    """
    around = np.asarray(contours_around(tree.cylinder))
    seen = project(image_from_world, around)
    across = seen.pixel[:, :PAIRS] - seen.pixel[:, PAIRS:]
    width = np.linalg.norm(across, axis=-1).reshape(tree.count, -1)
    front = (seen.depth > 0.0).reshape(tree.count, -1)
    widest = np.nan_to_num(width).max(axis=1, initial=0.0)
    return np.where(front.any(axis=1) & ~front.all(axis=1), np.inf, widest)


@jax.jit
def contours_around(
    cylinder: GeneralizedCylinder,
) -> Float[Array, "clusters angles knots 3"]:
    """Return points of the contours; those of the second half are opposite."""
    dtype = cylinder.skeleton.dtype
    angle = jnp.arange(2 * PAIRS, dtype=dtype) * (jnp.pi / PAIRS)
    one = jax.vmap(cylinder_knots, (None, None, 0))
    return jax.vmap(lambda mine: one(mine, 1.0, angle))(cylinder)


def cut_by_width(
    tree: HairTree, image_from_world: Matrix, pixels: float
) -> Int[np.ndarray, " cut"]:
    """Return the cut through the tree at which clusters look narrow, sorted.

    On each way from a root cluster to a leaf it is the first cluster that looks no
    wider than `pixels`, or the leaf where none does. So every leaf has exactly one
    cluster of the cut above it or is one itself, and the clusters of a cut for more
    pixels are those of a cut for less, or above them.

    Args:
        tree: The tree.
        image_from_world: The camera, as `select.project` takes it.
        pixels: The width, in pixels.

    Raises:
        ValueError: If `pixels` is not positive.
    """
    must_be_positive(pixels)
    return cut_at(tree, contour_widths(tree, image_from_world) <= pixels)


def cut_at(
    tree: HairTree, stop: Bool[np.ndarray, " clusters"]
) -> Int[np.ndarray, " cut"]:
    """Return the cut that goes down to the first clusters to stop at, or to leaves."""
    ends = stop.copy()
    ends[leaves(tree)] = True
    return np.flatnonzero(ends & ~marked_above(tree, ends))


def tree_of_cut(tree: HairTree, cut: Int[np.ndarray, " cut"]) -> HairTree:
    """Return the tree in which the clusters of a cut are the leaves.

    What is below them is gone, with the wisps that it owned: those tell how hair runs
    beside the clusters that are gone. Clusters keep their order but not their indices.

    Args:
        tree: The tree.
        cut: Clusters of which every leaf has exactly one above it or is one.

    Raises:
        ValueError: If `cut` is no such cut.
    """
    in_cut = np.zeros(tree.count, bool)
    in_cut[cut] = True
    below = marked_above(tree, in_cut)
    covered = (in_cut | below)[leaves(tree)].all()
    if not covered or (in_cut & below).any():
        raise ValueError(
            f"these {len(cut)} clusters are no cut: each leaf must have exactly one of "
            "them above it, or be one; `cut_by_width` makes a cut."
        )
    return take(tree, ~below)


def marked_above(
    tree: HairTree, marked: Bool[np.ndarray, " clusters"]
) -> Bool[np.ndarray, " clusters"]:
    """Return which clusters are below a marked one."""
    below = np.zeros(tree.count, bool)
    for i, above in enumerate(tree.parent):
        below[i] = above >= 0 and (marked[above] or below[above])
    return below


def must_be_positive(pixels: float) -> None:
    """Refuse a size in pixels that is not positive."""
    if not pixels > 0.0:
        raise ValueError(f"`pixels` must be positive, got {pixels}.")
