"""Hair on the other side of the head."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.ndimage import map_coordinates
from jaxtyping import Array, Float

from .contour import ANGLES
from .curve import EXACT
from .cylinder import GeneralizedCylinder
from .edit import Plane, check_cluster
from .locks import mirrored
from .maps import ScalpMaps
from .scalp import Scalp, scalp_point, scalp_tangents, scalp_uv
from .tree import HairTree, ScalpContour, descendants, graft, joined
from .vector import TINY, unit
from .wisp import Wisps

# Between the two halves of a head: x points to the person's left.
SAGITTAL = Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))


class Flip(NamedTuple):
    """How the mirror image of a cluster's surroundings lies in scalp space.

    Attributes:
        uv: The mirrored centre.
        turn: An angle `theta` becomes `turn - theta`.
        size: Lengths are multiplied by this.
    """

    uv: Float[Array, " 2"]
    turn: Float[Array, ""]
    size: Float[Array, ""]


class Mirrored(NamedTuple):
    """Mirrored clusters: contours and cylinders, stacked, and their flips."""

    contour: ScalpContour
    cylinder: GeneralizedCylinder
    flip: Flip


def mirror(tree: HairTree, plane: Plane = SAGITTAL) -> HairTree:
    r"""Return the mirror image of a hairstyle, on the same scalp.

    Strands of the result are exact mirror images where the scalp is symmetric. The
    mirror makes left-handed frames of right-handed ones; here the tangent and the
    normal are mirrored and the binormal is their product again, so that it runs the
    other way: angles $\theta$ are counted backwards, twist and shear change their sign,
    scales stay. In scalp space an angle becomes $\alpha - \theta$, where $\alpha$ is
    what the mirror does to the directions of u and v ($\pi$ if it turns u round); the
    contours start elsewhere by it, and the twist makes up for that:
    $W' = -W - \alpha$, $H' = -H$, $R'(\theta') = R(\alpha - \theta')$.

    On a scalp that is not symmetric, roots go to the points of it that are closest to
    their mirror images, and contours are scaled as the scalp is there.

    Wisps and painted maps are mirrored, too.

    Args:
        tree: The tree.
        plane: The plane of symmetry.
    """
    some = mirror_clusters(tree.scalp, tree.contour, tree.cylinder, reflection(plane))
    wisps = tree.wisps
    if wisps is not None:
        turn = some.flip.turn[wisps.owner]
        wisps = mirror_wisps(tree.scalp, wisps, turn, reflection(plane))
    maps = tree.maps
    if maps is not None:
        maps = mirror_maps(tree.scalp, maps, reflection(plane))
    locks = None if tree.locks is None else mirrored(tree.locks)
    return dataclasses.replace(
        tree,
        contour=some.contour,
        cylinder=some.cylinder,
        wisps=wisps,
        maps=maps,
        locks=locks,
    )


def mirror_cluster(
    tree: HairTree, index: int, plane: Plane = SAGITTAL, parent: int | None = None
) -> HairTree:
    """Return the tree with the mirror image of a cluster and all below it added.

    The added clusters stand behind those that the tree has. What is on the other side
    stays: `drop` it, before or after, if the image shall have its roots.

    Args:
        tree: The tree.
        index: The cluster.
        plane: The plane of symmetry.
        parent: What the image of the cluster belongs to, -1 for no other; None for the
            parent of the cluster itself.

    Raises:
        ValueError: If there is no such cluster.
    """
    check_cluster(tree, index)
    if parent is None:
        parent = tree.parent[index]
    elif parent != -1:
        check_cluster(tree, parent)
    family = np.concatenate([[index], descendants(tree, index)])
    place = {int(old): tree.count + row for row, old in enumerate(family)}
    some = jax.tree.map(
        lambda leaf: leaf[family], (tree.contour, tree.cylinder, tree.length_variation)
    )
    image = mirror_clusters(tree.scalp, some[0], some[1], reflection(plane))
    parents = [place.get(tree.parent[i], parent) for i in family.tolist()]
    grown = graft(tree, image.contour, image.cylinder, some[2], parents)
    if tree.locks is not None:
        copy = mirrored(jax.tree.map(lambda leaf: leaf[family], tree.locks))
        locks = jax.tree.map(joined, tree.locks, copy)
        grown = dataclasses.replace(grown, locks=locks)
    wisps = tree.wisps
    if wisps is None:
        return grown
    mine = np.flatnonzero(np.isin(np.asarray(wisps.owner), family))
    copy = jax.tree.map(lambda leaf: leaf[mine], wisps)
    row = np.asarray([place[int(i)] for i in copy.owner], int) - tree.count
    turn = image.flip.turn[row]
    copy = mirror_wisps(tree.scalp, copy, turn, reflection(plane))
    owner = jnp.asarray(row + tree.count, wisps.owner.dtype)
    copy = eqx.tree_at(lambda w: w.owner, copy, owner)
    both = jax.tree.map(lambda a, b: jnp.concatenate([a, b]), wisps, copy)
    return eqx.tree_at(lambda t: t.wisps, grown, both)


class Reflection(NamedTuple):
    """The mirror image of a point is `linear @ p + shift`."""

    linear: Float[Array, "3 3"]
    shift: Float[Array, " 3"]


def reflection(plane: Plane) -> Reflection:
    """Return the reflection at a plane."""
    point, normal = jnp.asarray(plane.point, float), jnp.asarray(plane.normal, float)
    normal = unit(normal, jnp.eye(3, dtype=normal.dtype)[0])
    linear = jnp.eye(3, dtype=normal.dtype) - 2.0 * jnp.outer(normal, normal)
    return Reflection(linear, 2.0 * jnp.dot(point, normal) * normal)


@jax.jit
def mirror_clusters(
    scalp: Scalp, contour: ScalpContour, cylinder: GeneralizedCylinder, at: Reflection
) -> Mirrored:
    """Return stacked clusters mirrored; see `mirror`."""
    at = jax.tree.map(lambda leaf: leaf.astype(scalp.control.dtype), at)

    def one(contour, cylinder):
        flip = flip_at(scalp, contour.centre, at)
        weights = turned_back(flip.turn)

        def around(offset):
            return jnp.matmul(offset, weights.T, precision=EXACT)

        rooted = eqx.tree_at(
            lambda c: (c.centre, c.radius, c.offset),
            contour,
            (flip.uv, flip.size * contour.radius, flip.size * around(contour.offset)),
        )
        skeleton = cylinder.skeleton @ at.linear.T + at.shift[None]
        grown = eqx.tree_at(
            lambda c: (c.skeleton, c.normal, c.offset, c.twist, c.shear),
            cylinder,
            (
                skeleton,
                at.linear @ cylinder.normal,
                around(cylinder.offset),
                -cylinder.twist - flip.turn,
                -cylinder.shear,
            ),
        )
        return Mirrored(rooted, grown, flip)

    return jax.vmap(one)(contour, cylinder)


def turned_back(turn: Float[Array, ""]) -> Float[Array, "32 32"]:
    """Return the weights that give a contour's offsets at the angles `turn - theta`.

    As hats: `contour_radius` finds the two neighbours of an angle first, and these may
    be rounded apart where the angle is one of the 32, as it is on a symmetric scalp.
    """
    at = turn * (ANGLES / (2.0 * jnp.pi))
    steps = jnp.arange(ANGLES, dtype=turn.dtype)
    apart = at - steps[:, None] - steps[None, :]
    apart = apart - ANGLES * jnp.round(apart / ANGLES)
    return jnp.maximum(1.0 - jnp.abs(apart), 0.0)


def flip_at(scalp: Scalp, uv: Float[Array, " 2"], at: Reflection) -> Flip:
    r"""Return how the mirror image of a root's surroundings lies in scalp space.

    The linear map from (u, v) to (u', v') is the one that takes the mirrored tangents
    to those at the mirrored root, and is rounded to the nearest $s \begin{pmatrix}
    \cos\alpha & \sin\alpha \\ \sin\alpha & -\cos\alpha \end{pmatrix}$.
    """
    there = mirror_uv(scalp, uv, at)
    tangents = jnp.stack(scalp_tangents(scalp, uv), axis=1)
    image = jnp.matmul(at.linear, tangents, precision=EXACT)
    basis = jnp.stack(scalp_tangents(scalp, there), axis=1)
    square = jnp.matmul(basis.T, basis, precision=EXACT)
    a, b, c = square[0, 0], square[0, 1], square[1, 1]
    det = a * c - b * b
    sound = det > TINY**2
    cofactors = jnp.stack([jnp.stack([c, -b]), jnp.stack([-b, a])])
    linear = jnp.matmul(basis.T, image, precision=EXACT)
    linear = jnp.matmul(cofactors, linear, precision=EXACT)
    linear = jnp.where(
        sound,
        linear / jnp.where(sound, det, 1.0),
        jnp.diag(jnp.array([-1.0, 1.0], uv.dtype)),
    )
    cos, sin = linear[0, 0] - linear[1, 1], linear[0, 1] + linear[1, 0]
    some = cos * cos + sin * sin > TINY**2
    turn = jnp.arctan2(jnp.where(some, sin, 0.0), jnp.where(some, cos, -1.0))
    area = jnp.abs(linear[0, 0] * linear[1, 1] - linear[0, 1] * linear[1, 0])
    wide = area > TINY**2
    size = jnp.where(wide, jnp.sqrt(jnp.where(wide, area, 1.0)), 0.0)
    return Flip(there, turn, size)


def mirror_uv(
    scalp: Scalp, uv: Float[Array, " 2"], at: Reflection
) -> Float[Array, " 2"]:
    """Return (u, v) of the scalp's point that is closest to a root's mirror image."""
    p = jnp.matmul(at.linear, scalp_point(scalp, uv), precision=EXACT) + at.shift
    return scalp_uv(scalp, p)


@jax.jit
def mirror_wisps(
    scalp: Scalp, wisps: Wisps, turn: Float[Array, " wisps"], at: Reflection
) -> Wisps:
    """Return wisps mirrored, with their clusters' angles `Flip.turn`."""
    at = jax.tree.map(lambda leaf: leaf.astype(scalp.control.dtype), at)
    uv = jax.vmap(mirror_uv, (None, 0, None))(scalp, wisps.uv, at)
    along, across, side = jnp.moveaxis(wisps.offset, 2, 0)
    cos, sin = jnp.cos(turn)[:, None], jnp.sin(turn)[:, None]
    offset = [along, cos * across + sin * side, sin * across - cos * side]
    return eqx.tree_at(
        lambda w: (w.uv, w.offset), wisps, (uv, jnp.stack(offset, axis=2))
    )


@jax.jit
def mirror_maps(scalp: Scalp, maps: ScalpMaps, at: Reflection) -> ScalpMaps:
    """Return painted maps mirrored: at each texel what is at its mirror image."""
    at = jax.tree.map(lambda leaf: leaf.astype(scalp.control.dtype), at)

    def one(values: Float[Array, "rows columns ..."]):
        rows, columns = values.shape[:2]
        u = jnp.linspace(0.0, 1.0, rows, dtype=values.dtype)
        v = jnp.linspace(0.0, 1.0, columns, dtype=values.dtype)
        uv = jnp.stack(jnp.meshgrid(u, v, indexing="ij"), axis=-1).reshape(-1, 2)
        there = jax.vmap(mirror_uv, (None, 0, None))(scalp, uv, at)
        place = [there[:, 0] * (rows - 1.0), there[:, 1] * (columns - 1.0)]
        channels = values.reshape(rows, columns, -1)

        def bilinear(channel):
            return map_coordinates(channel, place, order=1, mode="nearest")

        found = jax.vmap(bilinear, 2, 1)(channels)
        return found.reshape(values.shape)

    return jax.tree.map(one, maps)
