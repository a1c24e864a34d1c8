"""Hair where strands from elsewhere left gaps: clusters grow into them [Kim02, 7.5]."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from ..errors import InputError
from ..model.ownership import find_owner
from ..model.scalp import Scalp
from ..model.tiling import scale_clusters
from ..model.tree import HairTree, ScalpContour, children
from .borders import draw_contours
from .density import TEXELS, neighbour_distance
from .root_scalp import scalp_points

# How dense hair is in a gap: as at so many places beside it with hair.
BESIDE = 200
# Contours reach beyond the middles of the outermost texels by so many texels.
BEYOND = 0.75
# The smallest reach of a contour that can be scaled.
LEAST = 1e-6


def fill_in(
    tree: HairTree, uv: Float[np.ndarray, "strands 2"], gap: float = 0.02
) -> HairTree:
    """Return the tree with hair in the gaps between the roots of known strands.

    A gap is what a disc of radius `gap` cannot enter from the bare scalp: the closing
    of the roots, in metres on the scalp. The clusters around it grow over it, as their
    linear maps say, and its density is that of the hair around it. Hair that stands
    sparsely but evenly needs no more than `sample_strands`.

    Args:
        tree: The tree, whose maps hold the density of the roots.
        uv: The roots that it was made from, in scalp space.
        gap: Radius, in metres.

    Raises:
        InputError: If `gap` is not positive, or the tree has no map of density.
    """
    if not (np.isfinite(gap) and gap > 0.0):
        raise InputError(f"gaps to fill must be wider than 0 m, not {gap}.")
    if tree.maps is None:
        raise InputError(
            "the tree has no map of the hair's density; give one by `density_maps`."
        )
    places = texel_places()
    on, roots = scalp_points(tree.scalp, places), scalp_points(tree.scalp, uv)
    away = KDTree(roots).query(on)[0]
    haired = away <= reach_of_hair(tree.scalp, roots)
    empty = closed(on, away, gap) & ~haired
    if not empty.any() or not haired.any():
        return tree
    grown = own_places(tree, places[empty])
    density = np.array(tree.maps.density, np.float64).ravel()
    beside = KDTree(on[haired]).query(on[empty], k=min(BESIDE, haired.sum()))[1]
    density[empty] = density[haired][beside].reshape(empty.sum(), -1).mean(axis=1)
    painted = jnp.asarray(density.reshape(TEXELS, TEXELS), tree.maps.density.dtype)
    return eqx.tree_at(lambda t: t.maps.density, grown, painted)


def texel_places() -> Float[np.ndarray, "texels 2"]:
    """Return the places of a map's texels in scalp space, row by row."""
    side = np.linspace(0.0, 1.0, TEXELS)
    return np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2)


def reach_of_hair(scalp: Scalp, roots: Float[np.ndarray, "strands 3"]) -> float:
    """Return how far from a root the scalp counts as covered, in metres.

    It is the typical distance between neighbouring roots, and not less than a texel.
    """
    corners = np.asarray(scalp.control, np.float64)
    side = np.linalg.norm(np.diff(corners, axis=0), axis=2).sum(axis=0).mean()
    return max(neighbour_distance(roots), side / (TEXELS - 1))


def closed(
    on: Float[np.ndarray, "texels 3"], away: Float[np.ndarray, " texels"], gap: float
) -> Bool[np.ndarray, " texels"]:
    """Return the morphological closing of the roots by a ball, texel by texel.

    Args:
        on: The texels on the scalp, in metres.
        away: Distance of each from the closest root.
        gap: Radius of the ball.
    """
    border = np.zeros((TEXELS, TEXELS), bool)
    border[[0, -1]] = border[:, [0, -1]] = True
    bare = (away > gap) | border.ravel()
    return KDTree(on[bare]).query(on)[0] > gap


def own_places(tree: HairTree, places: Float[np.ndarray, "places 2"]) -> HairTree:
    """Return the tree whose root clusters' contours reach places without an owner.

    Each goes to the root cluster with the closest centre; below it, `find_owner` finds
    a leaf. All else stays, so that other roots keep their owners but where a contour
    that grows is the closest. Contours grow as `scale_clusters` has it.

    Args:
        tree: The tree.
        places: Places in scalp space.
    """
    places = places[np.asarray(find_owner(tree, places)) < 0]
    tops = np.asarray(children(tree, -1), int)
    if not len(places) or not len(tops):
        return tree
    centre = np.asarray(tree.contour.centre, np.float64)
    label = tops[KDTree(centre[tops]).query(places)[1]]
    margin = BEYOND / (TEXELS - 1)
    drawn = draw_contours(places, label, centre, against=0.0, margin=margin)
    reach = contour_reach(tree.contour)
    wider = reach.copy()
    held = np.unique(label)
    wider[held] = np.maximum(reach, contour_reach(drawn))[held]
    share = jnp.asarray(wider / np.maximum(reach, LEAST), tree.contour.radius.dtype)
    grown = scale_clusters(tree.contour, tree.cylinder, share)
    return eqx.tree_at(lambda t: (t.contour, t.cylinder), tree, tuple(grown))


def contour_reach(contour: ScalpContour) -> Float[np.ndarray, "clusters 32"]:
    """Return how far stacked contours reach along their spokes."""
    return np.asarray(contour.radius, np.float64)[:, None] + np.asarray(contour.offset)
