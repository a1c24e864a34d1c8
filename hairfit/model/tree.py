"""The hair tree: clusters under clusters, rooted on a scalp."""

import functools
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int, ScalarLike

from ..host import more_rows, on_device
from .certainty import TreeConfidence, heirs, unknown_confidence
from .contour import ANGLES, contour_radius
from .cylinder import GeneralizedCylinder
from .locks import Locks, unknown_locks
from .maps import ScalpMaps
from .scalp import Scalp, scalp_normal, scalp_point, scalp_tangents
from .vector import norm, reject
from .wisp import Wisps

Stackable = TypeVar("Stackable", bound=eqx.Module)


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
        wisps: What single hairs do beside their cluster, or None.
        maps: What is painted on the scalp, or None for even hair.
        confidence: How sure a fit is of each cluster, or None if none has said so.
        locks: How the curls of each cluster's hair wind together, or None where each
            hair curls for itself.
    """

    scalp: Scalp
    contour: ScalpContour
    cylinder: GeneralizedCylinder
    length_variation: Float[Array, " clusters"]
    parent: tuple[int, ...] = eqx.field(static=True)
    wisps: Wisps | None = None
    maps: ScalpMaps | None = None
    confidence: TreeConfidence | None = None
    locks: Locks | None = None

    def __check_init__(self):
        count = len(self.parent)
        for name in ("contour", "cylinder", "length_variation", "confidence", "locks"):
            for leaf in jax.tree.leaves(getattr(self, name)):
                if leaf.shape[:1] != (count,):
                    raise ValueError(
                        f"`{name}` of a tree of {count} clusters needs arrays of "
                        f"{count} rows, got the shape {leaf.shape}; `stack` makes them."
                    )
        for i, parent in enumerate(self.parent):
            if not -1 <= parent < i:
                raise ValueError(
                    f"cluster {i} has the parent {parent}; a parent is -1 or stands "
                    f"before its children."
                )

    @property
    def count(self) -> int:
        """The number of clusters, leaves and others."""
        return len(self.parent)


class Clusters(NamedTuple):
    """Clusters as arrays."""

    contour: ScalpContour
    cylinder: GeneralizedCylinder


def filled(tree: HairTree, room: int) -> Clusters:
    """Return a tree's clusters, the last again and again up to `room` of them."""
    return Clusters(
        *jax.tree.map(
            lambda leaf: on_device(more_rows(leaf, room)), (tree.contour, tree.cylinder)
        )
    )


def with_cylinders(tree: HairTree, cylinder: GeneralizedCylinder) -> HairTree:
    """Return the tree with other cylinders: the first of as many or more."""
    mine = jax.tree.map(
        lambda leaf: on_device(np.asarray(leaf)[: tree.count]), cylinder
    )
    return eqx.tree_at(lambda t: t.cylinder, tree, mine)


def stack(modules: Sequence[Stackable]) -> Stackable:
    """Return modules of one kind, such as planted clusters, as one stacked module."""
    if not modules:
        raise ValueError("`stack` needs at least one module, got none.")
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *modules)


def cluster(stacked: Stackable, index: int) -> Stackable:
    """Return one cluster of a stacked module."""
    return jax.tree.map(lambda leaf: leaf[index], stacked)


@functools.lru_cache(maxsize=64)
def depths_of(parent: tuple[int, ...]) -> np.ndarray:
    """Return each cluster's depth, 0 for root clusters."""
    depth = np.zeros(len(parent), np.int32)
    for i, above in enumerate(parent):
        depth[i] = 0 if above < 0 else depth[above] + 1
    depth.setflags(write=False)  # shared by all who ask
    return depth


def levels(tree: HairTree) -> tuple[np.ndarray, ...]:
    """Return the indices of the clusters of each level, root clusters first."""
    depth = depths_of(tree.parent)
    return tuple(np.flatnonzero(depth == i) for i in range(depth.max(initial=-1) + 1))


def leaves(tree: HairTree) -> np.ndarray:
    """Return the indices of the clusters without children, which alone own strands."""
    return np.setdiff1d(np.arange(tree.count), np.asarray(tree.parent, int))


def children(tree: HairTree, index: int) -> np.ndarray:
    """Return the indices of a cluster's children; of the root clusters for -1."""
    return np.flatnonzero(np.asarray(tree.parent, int) == index)


def descendants(tree: HairTree, index: int) -> np.ndarray:
    """Return the indices of all clusters below a cluster, in increasing order."""
    parent = tree.parent
    found = {index}
    for i in range(index + 1, len(parent)):
        if parent[i] in found:
            found.add(i)
    return np.array(sorted(found - {index}), int)


def take(tree: HairTree, keep: Bool[np.ndarray, " clusters"]) -> HairTree:
    """Return the tree of some clusters, which must have their parents among them."""
    index = np.flatnonzero(keep)
    number = np.where(keep, np.cumsum(keep) - 1, -1)
    parent = np.asarray(tree.parent, int)[index]
    shape = tree.contour, tree.cylinder, tree.length_variation
    contour, cylinder, variation, *known = jax.tree.map(
        lambda leaf: rows_of(leaf, index), (*shape, tree.confidence, tree.locks)
    )
    renumbered = tuple(int(number[p]) if p >= 0 else -1 for p in parent)
    wisps = tree.wisps
    if wisps is not None:
        owner = number[np.asarray(wisps.owner)]
        held = np.flatnonzero(owner >= 0)
        wisps = jax.tree.map(lambda leaf: rows_of(leaf, held), wisps)
        owner = jnp.asarray(owner[held], wisps.owner.dtype)
        wisps = eqx.tree_at(lambda w: w.owner, wisps, owner)
    parts = tree.scalp, contour, cylinder, variation, renumbered
    return HairTree(*parts, wisps, tree.maps, *known)


def rows_of(array: Array | np.ndarray, index: Int[np.ndarray, " rows"]) -> Array:
    """Return rows of an array, on the host: each number of rows would be compiled."""
    if isinstance(array, Tracer):
        return array[index]
    return on_device(np.asarray(array)[index])


def joined(first: Array | np.ndarray, second: Array | np.ndarray) -> Array:
    """Return the rows of two arrays, on the host for the same reason."""
    if isinstance(first, Tracer) or isinstance(second, Tracer):
        return jnp.concatenate([first, second])
    return on_device(np.concatenate([np.asarray(first), np.asarray(second)]))


def drop_descendants(tree: HairTree, index: int) -> HairTree:
    """Return the tree in which a cluster has no children: what was below it is gone.

    Clusters behind those that go change their indices, the cluster itself does not.
    """
    keep = np.ones(tree.count, bool)
    keep[descendants(tree, index)] = False
    return take(tree, keep)


def drop(tree: HairTree, index: int) -> HairTree:
    """Return the tree without a cluster and all below it."""
    keep = np.ones(tree.count, bool)
    keep[descendants(tree, index)] = False
    keep[index] = False
    return take(tree, keep)


def graft(
    tree: HairTree,
    contour: ScalpContour,
    cylinder: GeneralizedCylinder,
    length_variation: Float[Array, " added"],
    parent: Sequence[int],
) -> HairTree:
    """Return the tree with clusters added behind those that it has.

    Where the tree knows how sure a fit was, they are as certain as their parents, and
    their curls wind as those of their parents do.

    Args:
        tree: The tree.
        contour: Their scalp contours, stacked.
        cylinder: Their cylinders, stacked, with as many knots as the tree's.
        length_variation: Share of the length by which tips vary.
        parent: The parent of each, in the new tree, -1 for root clusters: clusters
            from `tree.count` on are the added ones, in their order.

    Raises:
        ValueError: If the numbers of knots differ or parents are not in order.
    """
    knots, added = tree.cylinder.skeleton.shape[1], cylinder.skeleton.shape[1]
    if knots != added:
        raise ValueError(
            f"clusters of {added} knots cannot be grafted onto a tree of {knots}; "
            "resample their skeletons first."
        )
    before = (tree.contour, tree.cylinder, tree.length_variation)
    contour, cylinder, variation = jax.tree.map(
        joined, before, (contour, cylinder, length_variation)
    )
    numbers = tree.parent + tuple(int(p) for p in parent)
    source = heirs(tree.count, numbers[tree.count :])

    def inherited(known, unknown):
        every = jax.tree.map(joined, known, unknown)
        return jax.tree.map(lambda leaf: rows_of(leaf, source), every)

    confidence, locks = tree.confidence, tree.locks
    if confidence is not None:
        confidence = inherited(confidence, unknown_confidence())
    if locks is not None:
        locks = inherited(locks, unknown_locks(knots))
    parts = tree.scalp, contour, cylinder, variation, numbers
    return HairTree(*parts, tree.wisps, tree.maps, confidence, locks)


def plant(
    scalp: Scalp, contour: ScalpContour, length: ScalarLike, knots: int
) -> GeneralizedCylinder:
    r"""Return a straight cluster that stands on the scalp over its contour.

    The skeleton leaves the contour's centre along the surface normal. The contour's
    points are taken to the scalp (4-5) and projected onto the plane there; their
    distances from the centre are the contour in the world (4-6), decomposed into
    their mean and offsets and copied to every knot.

    Equation (4-6) keeps distances but takes angles of scalp space for angles in the
    world, which holds only where the patch is conformal: elsewhere strands would
    leave their roots sideways, or mirrored if the patch is left-handed. So scale and
    shear hold the patch's own linear map $(S_u, S_v)$, divided by the root of its
    determinant, and (4-6) is measured in that map. On a conformal right-handed patch
    scale is 1, shear 0, and this is (4-6) to the letter.

    Args:
        scalp: The patch.
        contour: One contour in scalp space.
        length: Length of the skeleton, in metres.
        knots: Number of control points of the skeleton, 2 or more.
    """
    dtype = scalp.control.dtype
    angle = jnp.arange(ANGLES, dtype=dtype) * (2.0 * jnp.pi / ANGLES)
    reach = jax.vmap(contour_radius, (None, None, 0))(
        contour.radius, contour.offset, angle
    )
    spoke = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=1)
    around = contour.centre[None] + reach[:, None] * spoke

    root = scalp_point(scalp, contour.centre)
    up = scalp_normal(scalp, contour.centre)
    du, dv = scalp_tangents(scalp, contour.centre)
    normal = reject(du, up)
    binormal = jnp.cross(up, normal)
    nn, nb, bb = jnp.dot(du, normal), jnp.dot(dv, normal), jnp.dot(dv, binormal)
    # Where the patch is pinched to a point or a line, it has no map of its own.
    sound = nn * jnp.abs(bb) > 1e-6 * (nn * nn + nb * nb + bb * bb) + 1e-24
    size = jnp.sqrt(jnp.where(sound, nn * jnp.abs(bb), 1.0))
    scale_n = jnp.where(sound, nn / size, 1.0)
    scale_b = jnp.where(sound, bb / size, 1.0)
    shear = jnp.where(sound, nb / size, 0.0)

    spread = jax.vmap(scalp_point, (None, 0))(scalp, around) - root[None]
    y = jnp.sum(spread * binormal[None], axis=1) / scale_b
    x = (jnp.sum(spread * normal[None], axis=1) - shear * y) / scale_n
    distance = norm(jnp.stack([x, y], axis=1))
    radius = jnp.mean(distance)
    along = jnp.linspace(0.0, 1.0, knots, dtype=dtype) * length
    return GeneralizedCylinder(
        skeleton=root[None] + along[:, None] * up[None],
        normal=normal,
        radius=jnp.full(knots, radius, dtype),
        offset=jnp.tile((distance - radius)[None], (knots, 1)),
        scale=jnp.tile(jnp.stack([scale_n, scale_b])[None], (knots, 1)),
        twist=jnp.zeros(knots, dtype),
        shear=jnp.full(knots, shear, dtype),
    )
